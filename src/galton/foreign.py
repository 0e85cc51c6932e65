"""Objects of libraries that Galton does not import by itself, told by their classes' names."""


def is_instance_of(value: object, package: str, name: str) -> bool:
    """Whether a value's class, or one that it inherits from, has that name in that package; nothing is imported."""
    return any(cls.__name__ == name and cls.__module__.partition(".")[0] == package for cls in type(value).__mro__)
