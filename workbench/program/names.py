"""Names in programs: one rule for the program's own name, which holds in the language of every controller."""

from __future__ import annotations

import re

from workbench.program.rapid_words import GENERATED, PREDEFINED, TAKEN

_KRL = """and bas bool brake case char circ circ_rel confirm const continue decl def defdat deffct default do else end
enddat endfct endfor endif endloop endswitch endwhile enum exit ext extfct false for frame global goto halt if
import int interrupt is lin lin_rel loop not or ptp ptp_rel public pulse real repeat resume return sec signal
spline struc switch then to trigger true until wait when while xor"""
_URSCRIPT = """and break continue def else elif end false for global halt if in local loop mod not or return sec thread
true while xor movej movel movec set_tcp set_payload popup sync"""
RESERVED = frozenset(f"{_KRL} {_URSCRIPT}".split()) | TAKEN | PREDEFINED
LONGEST = 24  # KRL's
NUMBERED = re.compile(r"x[pv]\d+|xstart|xpark|xretract", re.IGNORECASE)  # positions in KRL


def program_name(name: str) -> str:
    """`name`, if programs of all controllers may have it; else ValueError."""
    spelt = re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST - 1}}}", name)
    if not spelt or name.lower() in RESERVED or GENERATED.fullmatch(name) or NUMBERED.fullmatch(name):
        raise ValueError(
            f"expected a letter, then letters, digits and _, at most {LONGEST} in all, no word of a robot's language"
        )
    return name
