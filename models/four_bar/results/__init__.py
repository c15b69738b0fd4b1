"""What the commands of the four-bar come to, a file a result: columns, record, tables, figures, files."""
