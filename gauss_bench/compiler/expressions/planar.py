"""Vectors of the plane whose components are nodes."""

from dataclasses import dataclass

from gauss_bench.compiler.expressions.node import Node


@dataclass(frozen=True, eq=False)
class Vector:
    """x and y; i turns by a quarter as in the complex plane."""

    x: Node
    y: Node

    def __add__(self, other: "Vector") -> "Vector":
        return Vector(self.x + other.x, self.y + other.y)

    def __sub__(self, other: "Vector") -> "Vector":
        return Vector(self.x - other.x, self.y - other.y)

    def __neg__(self) -> "Vector":
        return Vector(-self.x, -self.y)

    def __mul__(self, factor: Node | float) -> "Vector":
        return Vector(self.x * factor, self.y * factor)

    def dot(self, other: "Vector") -> Node:
        return self.x * other.x + self.y * other.y

    def cross(self, other: "Vector") -> Node:
        return self.x * other.y - self.y * other.x

    def turned(self, factor: Node | float = 1.0) -> "Vector":
        """i times the vector times a number: the velocity of an arm at an angular speed."""
        return Vector(-self.y * factor, self.x * factor)

    def rotated(self, by: "Vector") -> "Vector":
        """The product of two complex numbers."""
        return Vector(by.x * self.x - by.y * self.y, by.y * self.x + by.x * self.y)
