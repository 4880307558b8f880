"""Words of robots' languages: names that a program may have for its own."""

from __future__ import annotations

import re

IDENTIFIER = re.compile(r"[A-Za-z][A-Za-z0-9_]{0,31}")  # upper and lower case are the same to RAPID
_WORDS = """alias and backward case connect const default div do else elseif endfor endfunc endif endmodule endproc
endrecord endtest endtrap endwhile error exit false for from func goto if inout local mod module nostepin not noview or
pers proc raise readonly record retry return step sysmodule task test then to trap true trynext undo var viewonly while
with xor"""
_INSTRUCTIONS = "movel movec movej moveabsj confl confj cirpathmode setdo waitdi waittime actunit velset stop"
_TYPES = "num bool string pos orient pose robtarget jointtarget tooldata wobjdata loaddata speeddata zonedata"
TAKEN = frozenset(f"{_WORDS} {_INSTRUCTIONS} {_TYPES}".split())
# Data that every controller has: speeds in mm/s, zones in mm.
_SPEEDS = "5 10 20 30 40 50 60 80 100 150 200 300 400 500 600 800 1000 1500 2000 2500 3000 4000 5000 6000 7000 max"
_ZONES = "0 1 5 10 15 20 30 40 50 60 80 100 150 200"
PREDEFINED = frozenset(
    [*(f"v{v}" for v in _SPEEDS.split()), *(f"z{z}" for z in _ZONES.split()), "fine", "tool0", "wobj0", "load0"]
)
GENERATED = re.compile(r"(?:p|via|feed|layer|retract)\d+|zonepath", re.IGNORECASE)  # by `program.rapid`
_KRL = """and bas bool brake case char circ circ_rel confirm const continue decl def defdat deffct default do else end
enddat endfct endfor endif endloop endswitch endwhile enum exit ext extfct false for frame global goto halt if
import int interrupt is lin lin_rel loop not or ptp ptp_rel public pulse real repeat resume return sec signal
spline struc switch then to trigger true until wait when while xor"""
_URSCRIPT = """and break continue def else elif end false for global halt if in local loop mod not or return sec thread
true while xor movej movel movec set_tcp set_payload popup sync"""
RESERVED = frozenset(f"{_KRL} {_URSCRIPT}".split()) | TAKEN | PREDEFINED
LONGEST = 24  # KRL's
NUMBERED = re.compile(r"x[pv]\d+|xstart|xpark|xprobe|xretract", re.IGNORECASE)  # positions in KRL


def free_name(name: str) -> str:
    """`name`, if a program may use it for something of its own; else ValueError."""
    if not IDENTIFIER.fullmatch(name):
        raise ValueError("expected a letter, then letters, digits and _, at most 32 in all")
    if name.lower() in TAKEN | PREDEFINED or GENERATED.fullmatch(name):
        raise ValueError("expected a name that has no meaning in RAPID yet")
    return name


def program_name(name: str) -> str:
    """`name`, if programs of all controllers may have it; else ValueError."""
    spelt = re.fullmatch(rf"[A-Za-z][A-Za-z0-9_]{{0,{LONGEST - 1}}}", name)
    if not spelt or name.lower() in RESERVED or GENERATED.fullmatch(name) or NUMBERED.fullmatch(name):
        raise ValueError(
            f"expected a letter, then letters, digits and _, at most {LONGEST} in all, no word of a robot's language"
        )
    return name
