"""Model against measurement: the error in numbers, by what the command was doing."""
