"""One run of one engine on one mechanism: the recipe that every verb uses, in this process or in one of its own."""
