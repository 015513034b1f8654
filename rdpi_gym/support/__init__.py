"""What every room may use: errors, arrays, files, the store of rows, parallel runs, words."""
