"""The causes that are looked for, a file each; ``table`` names them."""
