"""One foreign thing each: the files by which running fleets are found."""
