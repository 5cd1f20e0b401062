"""Commands about messages: their layout, their keys, and programs that read them."""
