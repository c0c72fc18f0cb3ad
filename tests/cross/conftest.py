"""Tools outside Python that these tests compare with."""

import os
import shutil

import pytest


@pytest.fixture
def need_tool():
    """Returns ``(what it is for, names) -> path`` of the first of them that exists; without any, skips or fails."""

    def need(purpose, *names):
        found = next(filter(None, map(shutil.which, filter(None, names))), None)
        if found is None:
            missing = f"none of {', '.join(filter(None, names))} is on PATH"
            if os.environ.get("OHMLOOM_REQUIRE_TOOLS"):
                pytest.fail(f"{missing}, and OHMLOOM_REQUIRE_TOOLS is set")
            pytest.skip(f"{missing}: {purpose}")
        return found

    return need
