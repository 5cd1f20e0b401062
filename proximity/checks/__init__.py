"""What callers give, checked: numbers and arrays; every error says what was expected."""
