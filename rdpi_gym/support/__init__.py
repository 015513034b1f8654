"""Common tools: errors, arrays, files, the store of rows, parallel runs, wording."""
