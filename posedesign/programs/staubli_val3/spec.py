"""VAL 3 as the validator knows it: functions, elements and attributes of the XML, their values.

Sources as in the grammar. A function has its number of arguments only where that is sure.
"""

from __future__ import annotations

from posedesign.programs.reading import MOST_JOINT_DEG, MOST_POSITION_MM

_KEYWORDS = """and begin break call case default do else elseif end endfor endif endswitch endwhile
    for if or return step switch taskcreate taskcreatesync to until while xor"""
KEYWORDS = frozenset(_KEYWORDS.split())

_PREDEFINED = """true false world flange off joint cartesian lefty righty ssame sfree epositive
    enegative esame efree wpositive wnegative wsame wfree"""
PREDEFINED = frozenset(_PREDEFINED.split())
"""Names that no data file declares; in small letters, as all words here."""

_COUNTED = {
    (0, 0): """clock disablepower enablepower esstatus getmonitorspeed getmoveid herej iscalibrated
        isempty ispowered issettled restartmove stopmove waitendmove""",
    (0, 1): "cls getkey libsave resetmotion workingmode",
    (1, 1): """abs acos aioget asin autoconnectmove chr clearbuffer close cos delay dioget exp ln
        isinrange log open round rounddown roundup setmonitorspeed setmutex sin
        sqrt tan taskkill taskstatus tasksuspend trunc wait""",
    (1, 2): "libload logmsg popupmsg put putln size title",
    (2, 2): """aiolink aioset appro diolink dioset distance here max min sioget siolink sioset
        taskresume tostring watch""",
    (3, 3): "limit movej movel sel tonum",
    (4, 4): "movec",
    (0, 99): """accel align alter alterbegin alterend altermovec altermovej altermovel alterstoptime
        append asc atan band bnot bor bxor compose delete find first frombinary get getdate
        getdisplaylen getjointforce getlanguage getlatch getpositionerr getprofile getspeed
        getversion gotoxy help insert interpolatec interpolatel iobusstatus iostatus isdefined
        isin iskeypressed jointtopoint last left len libdelete libexist liblist libpath link mid
        movejf movelf next pointtojoint position pow prev random replace resetturn resize right
        safetyfault setframe setlanguage setlatch setmoveid setprofile sioctrl tobinary userpage""",
}
FUNCTIONS = {name: counts for counts, names in _COUNTED.items() for name in names.split()}
"""Least and most arguments of a function."""

TARGETS = ("pointRx", "pointRs", "point")
JOINT_TARGETS = ("jointRx", "jointRs", "joint", *TARGETS)

JOINTS = ("j1", "j2", "j3", "j4", "j5", "j6")
POINT = ("x", "y", "z", "rx", "ry", "rz")
CONFIG = ("shoulder", "elbow", "wrist")
_COORDINATES = " ".join(POINT)
_SPEEDS = "accel vel decel tmax rmax leave reach"
_CONFIG = " ".join(CONFIG)
VALUES = {
    "jointRx": " ".join(JOINTS),
    "jointRs": " ".join(JOINTS[:4]),
    "pointRx": f"{_COORDINATES} {_CONFIG} fatherId",
    "pointRs": f"{_COORDINATES} shoulder fatherId",
    "frame": f"{_COORDINATES} fatherId",
    "tool": f"{_COORDINATES} fatherId ioLink",
    "trsf": _COORDINATES,
    "config": _CONFIG,
    "mdesc": f"{_SPEEDS} blend",
    **dict.fromkeys(("num", "bool", "string"), "value"),
    **dict.fromkeys(("aio", "dio", "sio"), "link"),
    "screen": "",
}
"""Types of data, and the attributes of their values beside the key; any can be left out."""

LIMITS = {
    **dict.fromkeys(JOINTS, MOST_JOINT_DEG),
    **dict.fromkeys(POINT[:3], MOST_POSITION_MM),
    **dict.fromkeys(POINT[3:], 360.0),
    **dict.fromkeys(_SPEEDS.split(), 1e6),
}
"""Attributes that are numbers, and the largest that is believed [deg, mm, percent]."""

XSI_TYPE = "{http://www.w3.org/2001/XMLSchema-instance}type"

FORMS = {
    "name": r"[A-Za-z]\w{0,99}",
    "type": r"(?:[A-Za-z]\w{0,99}:)?[A-Za-z]\w{0,99}",
    "size": r"\d{1,6}(?: \d{1,6}){0,2}",
    "dimensions": r"[1-3]",
    "shoulder": "lefty|righty|sfree|ssame",
    "elbow": "epositive|enegative|efree|esame",
    "wrist": "wpositive|wnegative|wfree|wsame",
    "blend": "off|joint|[Cc]artesian",
    "access": "public|private",
    "use": "value|reference",
    "file": r"(?:[A-Za-z][\w -]{0,40}[/\\]){0,5}[A-Za-z]\w{0,99}\.(?:pgx|dtx)",
    "version": r"s\d{1,3}(?:\.\d{1,3}){0,2}(?:[A-Za-z][\w.-]{0,30})?",
    "stackSize": r"\d{1,9}",
    "millimeterUnit": "true|false",
    "autoload": "true|false",
    XSI_TYPE: "array|collection|element",
}
"""Patterns of attributes that are one of several words, or have a form."""

_DECLARED = f"name! type! size access {XSI_TYPE}!"
ELEMENTS = {
    ".dtx": {
        "Database": ("", "Datas!"),
        "Datas": ("", "Data*"),
        "Data": (_DECLARED, "Value*"),
        "Field": (_DECLARED, "Value*"),
    },
    ".pjx": {
        "Project": ("", "Parameters! Programs! Database! Libraries Types"),
        "Parameters": ("version! stackSize! millimeterUnit!", ""),
        "Programs": ("", "Program*"),
        "Program": ("file!", ""),
        "Database": ("", "Data!"),
        "Data": ("file!", ""),
        "Libraries": ("", "Library*"),
        "Library": ("alias! path! autoload password", ""),
        "Types": ("", "Type*"),
        "Type": ("name! path!", ""),
    },
    ".pgx": {
        "Programs": ("", "Program!"),
        "Program": ("name! access", "Description Parameters Locals Code!"),
        "Description": ("", ""),
        "Parameters": ("", "Parameter*"),
        "Parameter": (f"name! type! use dimensions {XSI_TYPE}!", ""),
        "Locals": ("", "Local*"),
        "Local": (_DECLARED.removesuffix("!"), "Value*"),
        "Field": (_DECLARED, "Value*"),
        "Code": ("", ""),
    },
}
"""Attributes of elements (! must be there), and what stands in them (! once, * any number of times,
at most once without), by the ending of the file, with the root first.

What stands in a ``Value`` depends on the type.
"""
