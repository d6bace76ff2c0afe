r"""ABB RAPID: words that every controller knows, and what motions and waits are called with.

Sources: ABB, Technical reference manual RAPID Instructions, Functions and Data types
(3HAC050917-001 and its forerunners). Modules, options and newer controllers add others.
"""

from __future__ import annotations

from collections.abc import Set

from posedesign.programs import rules

_SIGNATURES = r"""
MoveAbsJ \Conc, jointtarget \ID \NoEOffs, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \TLoad
MoveJ \Conc, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \TLoad
MoveL \Conc, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \Corr \TLoad
MoveC \Conc, robtarget, robtarget \ID, speeddata \V \T, zonedata \Z \Inpos, tooldata \WObj \Corr\
 \TLoad
WaitTime \InPos, num
WaitRob \InPos \ZeroSpeed
VelSet num, num
PulseDO \High \PLength, signaldo
ConfJ \On \Off
ConfL \On \Off
""".replace("\\\n", "")


def _names(text: str) -> frozenset[str]:
    return frozenset(text.upper().split())


def _signature(text: str) -> list[tuple[str, frozenset[str]]]:
    found = []
    for part in text.split(","):
        kinds = [word for word in part.split() if word[0] != "\\"]
        switches = _names(" ".join(word[1:] for word in part.split() if word[0] == "\\"))
        found.append(("".join(kinds), switches))
    return found


SIGNATURES = {
    line.split()[0].upper(): _signature(line.partition(" ")[2])
    for line in _SIGNATURES.strip().splitlines()
}
"""Types and switches of the arguments of instructions, by name in capitals; switches in front of
the first argument have no type."""

QUIET = _names("""
AccSet Add Break Clear ConfJ ConfL Decr Incr Reset Set SetAO SetDO SetGO SingArea Stop TPErase
TPWrite VelSet WaitDI WaitDO WaitRob WaitTime WaitUntil
""")
"""Instructions that measure nothing and move nothing."""

INSTRUCTIONS = QUIET | _names("""
ActUnit AliasIO BitClear BitSet BookErrNo CallByVar ClearPath ClearRawBytes ClkReset ClkStart
ClkStop Close DeactUnit EOffsOff EOffsOn EOffsSet ErrWrite ExitCycle GripLoad IDelete IDisable
IEnable InvertDO ISignalAI ISignalDI ISignalDO ISignalGI ISleep ITimer IWatch Load MotionSup
MoveAbsJ MoveC MoveCDO MoveExtJ MoveJ MoveJDO MoveJSync MoveL MoveLDO MoveLSync Open PackRawBytes
PathResol PDispOff PDispOn PDispSet PulseDO RestoPath Save SearchC SearchL SocketAccept SocketBind
SocketClose SocketConnect SocketCreate SocketListen SocketReceive SocketSend SpeedRefresh StartLoad
StartMove StopMove StorePath SyncMoveOff SyncMoveOn TPReadFK TPReadNum TPShow TriggC TriggEquip
TriggInt TriggIO TriggJ TriggL UIMsgBox UnLoad UnpackRawBytes WaitAI WaitAO WaitGI WaitGO WaitLoad
WaitSyncTask WorldAccLim Write WriteBin WriteStrBin WZFree
""")

FUNCTIONS = _names("""
Abs ACos AInput AOutput ArgName ASin ATan ATan2 BitAnd BitCheck BitNeg BitOr BitXOr ByteToStr
CalcJointT CalcRobT CDate CJointT ClkRead Cos CPos CRobT CTime CTool CWObj DefFrame Dim DInput
Distance DnumToNum DOutput EulerZYX GetSysInfo GetTime GInput GOutput IsFile IsPers IsVar MirPos
NOrient NumToDnum NumToStr Offs OpMode OrientZYX ORobT PoseInv PoseMult PoseVect Pow Present
RawBytesLen ReadBin ReadMotor ReadNum ReadStr ReadStrBin RelTool RobOS Round RunMode Sin
SocketGetStatus SocketPeek Sqrt StrFind StrLen StrMap StrMatch StrMemb StrPart StrToByte StrToVal
Tan TestDI Trunc UIAlphaEntry UIListView UIMessageBox UINumEntry ValToStr VectMagn
""")

TYPES = _names("""
bool byte clock confdata dnum errnum extjoint identno intnum iodev jointtarget loaddata loadsession
mecunit motsetdata num orient pos pose progdisp rawbytes robjoint robtarget shapedata signalai
signalao signaldi signaldo signalgi signalgo socketdev speeddata stoppointdata string switch
syncident tasks tooldata trapdata triggdata wobjdata zonedata
""")

_DATA = {
    "speeddata": "v5 v10 v20 v30 v40 v50 v60 v80 v100 v150 v200 v300 v400 v500 v600 v800 v1000 "
    "v1500 v2000 v2500 v3000 v4000 v5000 v6000 v7000 vmax vrot1 vrot2 vrot5 vrot10 vrot20 vrot50 "
    "vrot100 vlin10 vlin20 vlin50 vlin100 vlin200 vlin500 vlin1000",
    "zonedata": "z0 z1 z5 z10 z15 z20 z30 z40 z50 z60 z80 z100 z150 z200 fine",
    "tooldata": "tool0",
    "wobjdata": "wobj0",
    "loaddata": "load0",
}
DATA = {name: kind for kind, names in _DATA.items() for name in _names(names)}
"""Types of the data that every controller has, by name in capitals."""


_WITHOUT_MARK = {
    name + switch: f"{name}\\{switch}"
    for name, signature in SIGNATURES.items()
    for switch in signature[0][1]
}
"""Instructions that lack what stands in front of a switch: ``ConfJOn``."""


def misspelt(word: str, known: Set[str]) -> str:
    """The known word that a word in capitals was meant to be; empty for none.

    Figures at the end, and added letters that double none, are none of a mistake: people number
    and lengthen what they name.
    """
    if word in _WITHOUT_MARK:
        return _WITHOUT_MARK[word]
    if word.rstrip("0123456789_") in known:
        return ""
    halved = {word[:i] + word[i + 1 :] for i in range(2, len(word)) if word[i] == word[i - 1]}
    longer = [other for other in known if len(other) >= len(word) or other in halved]
    return rules.near(word, longer, 4)
