"""`python -m tests.foreign` prints the tables of docs/wall.md."""

from tests.foreign.cases import tables

if __name__ == "__main__":
    print(tables())
