"""Command lines and progress reports, for `derive` and `solve`: standard library and Rich only."""
