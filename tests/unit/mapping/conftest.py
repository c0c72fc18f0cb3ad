"""Hardware for tests: a shipped spec with some sections changed, checked like a file."""

import pytest

from ohmloom.mapping import Hardware


def quantity(value):
    return {"value": value, "source": "definition: a test"}


@pytest.fixture(scope="session")
def changed():
    def change(spec, **sections):
        """The shipped spec with sections updated; numbers become quantities, None removes a key."""
        table = Hardware.load(spec).model_dump(exclude_none=True)
        for section, keys in sections.items():
            if not isinstance(keys, dict):
                table[section] = keys
                continue
            part = dict(table.get(section) or {})
            for key, value in keys.items():
                part.pop(key, None)
                if value is not None:
                    part[key] = quantity(float(value)) if isinstance(value, float) else value
            table[section] = part
        return Hardware._from_table(table, "test.toml")

    return change
