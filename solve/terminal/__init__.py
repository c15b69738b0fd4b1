"""Command lines and progress reports of `derive` and `solve`. Only the standard library and Rich are used."""
