"""Reading a table in stretches changes nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from workbench.errors import InputError
from workbench.importing import text as texts
from workbench.importing.mapping_parts import ProfileColumns, ProfilesPart
from workbench.importing.text import read_table

FORM = ProfilesPart(length_unit="mm", frames="one", skip_lines=2, columns=ProfileColumns(x="a", z=1))
TEXT = "\n\na,b\n1,2\n\n\n3,4\n5,\n\n7,8\n\n"


@pytest.mark.parametrize("slab_bytes", [1, 4, 5, 6, 7, 9, 12, 1000])
def test_stretches(slab_bytes: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(texts, "SLAB_BYTES", slab_bytes)
    (tmp_path / "t.csv").write_text(TEXT)
    read = read_table(tmp_path / "t.csv", FORM)
    np.testing.assert_array_equal(read.columns["x"], [1, 3, 5, 7])
    np.testing.assert_array_equal(read.columns["z"], [2, 4, np.nan, 8])
    np.testing.assert_array_equal(read.line, [4, 7, 8, 10])
    np.testing.assert_array_equal(read.after_blank, [False, True, False, True])
    with pytest.raises(InputError, match=r"line 8: column 'b': no number"):
        read.present("z")
