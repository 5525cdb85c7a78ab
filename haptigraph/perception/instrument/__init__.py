"""The model of an instrument in volumes, learned from them, and its pose by registration."""
