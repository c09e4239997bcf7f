"""Commands for people: draw worlds and maps, spawn models, save a picture."""
