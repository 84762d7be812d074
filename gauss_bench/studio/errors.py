"""Refusals of the studio, in a sentence for whoever asked."""


class Refused(ValueError):
    """Something that is not done.

    Attributes:
        where: what of the drawing it is about, as `links.NAME`, `pins.ID`, `slides.NAME`, `forces.NAME`.
        field: the key that is at fault, or "".
    """

    def __init__(self, text: str, where: tuple[str, ...] = (), field: str = ""):
        self.where, self.field = where, field
        super().__init__(text)
