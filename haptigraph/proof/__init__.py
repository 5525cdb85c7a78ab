"""From a procedure to what is certain of it: claims proved over every possible graph, moments explained."""
