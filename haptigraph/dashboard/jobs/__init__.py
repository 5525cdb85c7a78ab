"""Work that takes seconds or longer, each job in a process of its own."""
