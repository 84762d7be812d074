"""The error by which the studio refuses a request, with a sentence for the user."""


class Refused(ValueError):
    """The refusal of a request.

    Attributes:
        where: ids of the parts of the drawing that the refusal concerns: `links.NAME`, `pins.ID`, `slides.NAME`, `forces.NAME`.
        field: key of the message that is at fault, or "".
    """

    def __init__(self, text: str, where: tuple[str, ...] = (), field: str = ""):
        self.where, self.field = where, field
        super().__init__(text)
