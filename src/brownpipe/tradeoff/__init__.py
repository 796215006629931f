"""The price list: how far every engine and setting is from the exact one, and what a run of it costs."""
