"""Files of the field beside a campaign: thrust curves, decks, soundings, damaged at random."""

import math
from functools import cache
from io import BytesIO
from pathlib import Path

import numpy as np
import pandas as pd

from fuzz.places import scratch
from fuzz.watch import Wrong, turns
from sepmc.formats.files import read_files
from sepmc.formats.telemetry import parse_map, read_telemetry
from sepmc.formats.text_table import FormatError
from sepmc.physics.atmosphere import us1976
from sepmc.scene.as_brought import convert_tree
from sepmc.scene.messages import InputError, Problems

# file ending, kind and text of small files to start from
SEEDS = (
    (".eng", "motor", "; a\nC6 18 70 0-3 0.01 0.02 E\n0.1 10\n0.3 14\n0.3 5\n1.2 0.0\n;\n"),
    (".csv", "motor", "time (s);thrust (lbf)\n0;1\n0.5;2\n1;0\n"),
    (".csv", "motor", "# x\nTime,Thrust\n[s],[N]\n0,1\n0.5,2\n"),
    (".csv", "aero", "mach,alpha,CA,CN,CMQ\n1,-5,1,2,4\n1,5,1,2,4\n2,5,1,2,4\n2,-5,1,1,1\n"),
    (".csv", "aero", "alpha_deg\tbeta_deg\tCL\tCD\n0\t0\t1\t2\n5\t0\t1\t2\n"),
    (".txt", "aero", " MACH CA CY CLN\n 1.0 0.1 0.2 .3D0\n 2.0 0.1 0.2 0.3\n"),
    (".csv", "air", "height (m);pressure (hPa);temperature (C)\n0;1013;15\n1000;900;5\n"),
    (".csv", "air", "altitude_km,density_kg_per_m3\n0,1.2\n10,0.4\n"),
    (".csv", "wind", "altitude_m,speed_kn,from_deg\n0,5,270\n1000,10,280\n"),
    (
        ".txt",
        "wind",
        "   PRES   HGHT   TEMP   DWPT   RELH   MIXR   DRCT   SKNT\n    hPa      m\n"
        "  980.0    360   10.0    8.0     87   6.90    180      5\n"
        "  850.0   1500    2.0   -1.0     80   4.20    250     20\n",
    ),
    (
        ".dat",
        "aero",
        "1   ***** THE USAF AUTOMATED MISSILE DATCOM *****     CASE   1\n 11  $REFQ SREF=1.0,\n"
        " MACH NO  =  0.8\n SIDESLIP =  0.00 DEG\n"
        "  ALPHA   CN    CM    CA    CY   CLN   CLL\n  -5.0  -1.0  1.0  0.3  0.0  0.0  0.0\n"
        "   5.0   1.0 -1.0  0.3  0.0  0.0  0.0\n  DERIVATIVES (PER DEGREE)\n"
        "  ALPHA  CNA  CMA  CYB  CLNB  CLLB\n  -5.0  9. -9. -2. 1. -.1\n"
        "   5.0  9. -9. -2. 1. -.1\n",
    ),
    (
        ".out",
        "aero",
        "1 THE FOLLOWING IS A LIST OF ALL INPUT CARDS FOR THIS CASE.\n $BODY NX=8.0$\n"
        " CASEID A\n NEXT CASE\n1 AUTOMATED METHODS PER 1976 VERSION OF DATCOM\n IN SIDESLIP\n"
        " WING-BODY CONFIGURATION\n A\n --  FLIGHT CONDITIONS  --    --  REFERENCE DIMENSIONS  --\n"
        "0 0.500     4.2600E+06    2.250      0.800     3.000     2.600     0.000\n"
        "0 ALPHA     CD       CL       CM       CN       CA\n0\n"
        "   -2.0    0.020   -0.140    0.0300  -0.141    0.015\n"
        "    2.0    0.020    0.140   -0.0300   0.141    0.015\n",
    ),
)  # fmt: skip
_OEM = (
    "CCSDS_OEM_VERS = 2.0\nMETA_START\nCENTER_NAME = EARTH\nREF_FRAME = EME2000\nMETA_STOP\n"
    "2026-03-01T00:00:00 6500 0 0 0.1 2 0.3\n2026-03-01T00:00:09 6500.5 20 1 0.1 2 0.3\n"
    "COVARIANCE_START\n1\nCOVARIANCE_STOP\n"
)
_AEM = (
    "CCSDS_AEM_VERS = 1.0\nMETA_START\nREF_FRAME_A = EME2000\nREF_FRAME_B = SC_BODY_1\n"
    "ATTITUDE_DIR = A2B\nATTITUDE_TYPE = {}\nMETA_STOP\nDATA_START\n"
    "2026-03-01T00:00:00 {}\n2026-03-01T00:00:09 {}\nDATA_STOP\n"
)
_URDF = (
    '<robot name="r"><link name="a"><inertial><origin xyz="1 0 .5" rpy="0.1 0 0"/>'
    '<mass value="2"/><inertia ixx="1" ixy=".1" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
    '</link><link name="b"/></robot>'
)
_MJCF = (
    '<mujoco><compiler angle="degree" eulerseq="xyz"/><worldbody><body name="a">'
    '<inertial pos="0 0 1" mass="2" diaginertia="1 1 1" {}/></body></worldbody></mujoco>'
)
_JSBSIM = (
    '<?xml version="1.0"?>\n<fdm_config><mass_balance negated_crossproduct_inertia="false">\n'
    '<ixx unit="KG*M2"> 70 </ixx><iyy> 205 </iyy><izz> 212 </izz><ixz> 3 </ixz>\n'
    '<emptywt unit="LBS"> 300 </emptywt><location name="CG" unit="M"><x>1</x><y>0</y><z>0</z>\n'
    "</location></mass_balance></fdm_config>"
)
_DAVEML = (
    '<?xml version="1.0"?><!DOCTYPE DAVEfunc SYSTEM "DAVEfunc.dtd"><DAVEfunc>\n'
    '<variableDef name="machNumber" varID="M"/><variableDef name="alpha" varID="a" units="deg"/>\n'
    '<variableDef name="Cm" varID="c"/><breakpointDef bpID="x"><bpVals>1, 2</bpVals>\n'
    '</breakpointDef><breakpointDef bpID="y"><bpVals>-5 0 5</bpVals></breakpointDef>\n'
    '<griddedTableDef gtID="t"><breakpointRefs><bpRef bpID="x"/><bpRef bpID="y"/>\n'
    "</breakpointRefs><dataTable>1,2,3\n4,5,6</dataTable></griddedTableDef><function>\n"
    '<independentVarRef varID="M"/><independentVarRef varID="a"/><dependentVarRef varID="c"/>\n'
    '<functionDefn><griddedTableRef gtID="t"/></functionDefn></function></DAVEfunc>'
)
SEEDS += (
    (".dml", "aero", _DAVEML),
    (".oem", "initial", _OEM),
    (".oem", "initial", _OEM.replace("EME2000", "ITRF").replace("\n2026-03-01T00:00:09", "\n")),
    (".aem", "initial", _AEM.format("QUATERNION\nQUATERNION_TYPE = LAST", "0 0 0 1", "0 0 .1 1")),
    (".aem", "initial", _AEM.format("EULER_ANGLE\nEULER_ROT_SEQ = 321", "0 0 9", "0 1 .1")),
    (".urdf", "mass", _URDF),
    (".xml", "mass", _MJCF.format('quat="1 0 .2 0"')),
    (".xml", "mass", _MJCF.format('euler="10 0 20"')),
    (".xml", "mass", _MJCF.format('xyaxes="1 0 0 0 1 0"')),
    (".xml", "mass", _JSBSIM),
    (".csv", "flight", "time (s);upper_omega_y_rad_s;acc [m/s2]\n0;1;2\n0.5;2;\n1;nan;3\n"),
    (".csv", "flight", "t,gyro_y (deg/s),x\n0,1,2\n0.5,2,1\n1,2,3\n"),
    (".parquet", "flight", ""),
)
_XML = (
    '<?xml version="1.0"?><{0} id="CCSDS" version="2.0"><header/><body><segment><metadata>\n'
    "<CENTER_NAME>EARTH</CENTER_NAME><REF_FRAME>EME2000</REF_FRAME>{1}</metadata><data>\n"
    "{2}</data></segment></body></{0}>"
)
_STATE = (
    "<stateVector><EPOCH>2026-03-01T00:00:0{}</EPOCH><X>6500.{}</X><Y>{}</Y>\n<Z>1</Z>"
    '<X_DOT units="km/s">0.1</X_DOT><Y_DOT>2</Y_DOT><Z_DOT>.3</Z_DOT></stateVector>\n'
)
_TURNED = (
    "<REF_FRAME_A>EME2000</REF_FRAME_A><REF_FRAME_B>SC_BODY</REF_FRAME_B><ATTITUDE_DIR>A2B"
    "</ATTITUDE_DIR><EULER_ROT_SEQ>321</EULER_ROT_SEQ><ATTITUDE_TYPE>{}</ATTITUDE_TYPE>"
)
_TURN = "<attitudeState><s><EPOCH>2026-03-01T00:00:0{}</EPOCH>{}</s></attitudeState>\n"
_QUATERNION = "<quaternion><QC>1</QC><Q1>0</Q1><Q2>0</Q2><Q3>0</Q3></quaternion>"
_ROTATIONS = (
    '<rotationAngles><rotation1 angle="Z_ANGLE">1</rotation1><rotation2>2</rotation2>'
    '<rotation3 units="deg">3</rotation3></rotationAngles>'
)
SEEDS += (
    (".xml", "initial", _XML.format("oem", "", _STATE.format(0, 0, 0) + _STATE.format(9, 9, 18))),
    (
        ".aem",
        "initial",
        _XML.format(
            "aem",
            _TURNED.format("QUATERNION"),
            _TURN.format(0, _QUATERNION) + _TURN.format(9, _QUATERNION),
        ),
    ),
    (
        ".aem",
        "initial",
        _XML.format("aem", _TURNED.format("EULER_ANGLE"), _TURN.format(4, _ROTATIONS)),
    ),
    (".csv", "motor", "0,1\n0.5,2\n1,0\n"),
    (
        ".txt",
        "wind",
        "%TITLE%\n OAX   140616/1900\n\n   LEVEL  HGHT  TEMP  DWPT  WDIR  WSPD\n----\n%RAW%\n"
        " 1000.00, 34.00, -9999, -9999, -9999, -9999\n 965.0, 350.0, 27.8, 23., 150., 2\n"
        " 850.00, 1500.00, 15.00, 9.00, 200.00, 30.00\n%END%\n",
    ),
    (".csv", "aero", "Mach,Alpha,CA Power-Off,CA Power-On,CN\n0.5,0,1,2,3\n0.5,4,1,2,3\n"),
    (".csv", "flight", "# a\n# t,gyro_y (deg/s),x (\u200b)\n# Event at t=0\n0,1,IMU\n1,2,x\n"),
    (".csv", "motor", "# time_s,thrust_lbf\n0,1\n0.5,2\n1,0\n"),
)
_AXES = ("forward-left-up", "aft-right-up", "up-up-up", 3, None)
_TIMES = ("2026-03-01T00:00:04", "2026-03-01T00:00:00", "2027-060T00:00:04", "x", 7, None)
_COLUMNS = ("upper_omega_y_deg_s", "upper_axial_acceleration_m_s2", "signal_x")
_MAPS = (
    (), (), ("upper_omega_y_deg_s=-gyro_y",), ("signal_x=2*x", "upper_omega_y_deg_s=gyro_y[rad/s]"),
    ("upper_axial_acceleration_m_s2=acc",), ("signal_x=a.x",), ("signal_x=1e999*x",), ("=",),
)  # fmt: skip
_PIECES = (
    ";", ",", "\t", " ", "\n", "\n\n", "#", '"', "0", "-1", "1e999", "nan", "inf", "0,5", "1.5",
    ".", "-", "mach", "CA", "(N)", "[", "]", "ALPHA", "MACH NO =", "NDM", "****", "\x00", "\xff",
    "é", "\u2028", "\x0b", "9" * 400, "_", "e", "1e-320", "case", "CASE   2\n", "PER RADIAN",
    "<", ">", "</", "/>", "&amp;", "&a;", "<!DOCTYPE r [<!ENTITY a 'b'>]>", "<!--", "]]>", "='",
    "${m}",
    "META_STOP\n", "META_START\n", "1e300", "2026-03-01T00:00:05", "QUATERNION", "-0.0", "rpy",
)  # fmt: skip
_OPTIONS = (
    {}, {}, {}, {"engine": "C6"}, {"engine": 1}, {"engine": []}, {"case": 2}, {"case": "x"},
    {"configuration": "wing"}, {"configuration": [1]},
    {"sideslip_deg": -1}, {"columns": ["a", "b"]}, {"columns": {"thrust_N": "Thrust"}},
    {"columns": {"normal": {"column": "CA", "scale": "x"}}}, {"columns": 7},
    {"total_impulse_N_s": 12.0}, {"total_impulse_x": 1}, {"interpolation": "linear"},
    {"mirror": "alpha"}, {"above": "us1976"}, {"mach": [1.0]}, {"time_s": 3},
)  # fmt: skip


def files(rng, count, until, tried):
    """Damaged files, each in a tree that names it."""
    us1976(0.0)  # compiled now: within an input it can take longer than an input may
    with scratch() as folder:
        for number in turns(count, until, tried):
            ending, kind, text = rng.choice(SEEDS)
            data = _damaged(rng, text) if text else _damaged_bytes(rng)
            path = (
                folder / f"{number % 8}{rng.choice((ending, ending, ending, '.csv', '.parquet'))}"
            )
            path.write_bytes(data)
            options = _options(rng, kind, folder)
            said = (path.name, kind, options, data[:500])
            tried.look(said, lambda p=path, k=kind, o=options: _read(p.name, k, dict(o), folder))


def _options(rng, kind, folder):
    """Options of a kind; those of a trajectory name a second file, damaged or not."""
    if kind == "initial":
        options = {"epoch": rng.choice(_TIMES)}
        if rng.random() < 0.5:
            attitude = rng.choice([text for end, _, text in SEEDS if end == ".aem"])
            (folder / "s.aem").write_bytes(_damaged(rng, attitude))
            options["attitude"] = {"file": "s.aem", "axes": rng.choice(_AXES)}
        if rng.random() < 0.3:
            options["azimuth_deg"] = rng.choice((90.0, -1e9, "x", True))
    elif kind == "mass":
        options = {"axes": rng.choice(_AXES), "link": rng.choice(("a", "b", 3, None, None))}
        if rng.random() < 0.2:
            options["origin_m"] = rng.choice(([1.0, 0, 0], [1, 2], "x", [1, 2, True]))
    elif kind == "flight":
        return {"maps": rng.choice(_MAPS), "time": rng.choice((None, None, None, "t", "x"))}
    else:
        return rng.choice(_OPTIONS)
    return {key: value for key, value in options.items() if value is not None}


def _damaged_bytes(rng):
    """A Parquet file of telemetry with some bytes changed, left out or doubled."""
    data = bytearray(_binary())
    for _ in range(rng.choice((0, 1, 1, 2, 4))):
        at = rng.randrange(len(data))
        way = rng.randrange(3)
        if way == 0:
            data[at] = rng.randrange(256)
        elif way == 1:
            del data[at : at + rng.choice((1, 4, 40))]
        else:
            data[at:at] = data[max(0, at - 8) : at]
    return bytes(data)


@cache
def _binary():
    """A small Parquet file of telemetry."""
    time = np.arange(6) * 0.1
    stream = BytesIO()
    pd.DataFrame({"time_s": time, "gyro_y": time**2, "x": time}).to_parquet(stream)
    return stream.getvalue()


def _damaged(rng, text):
    for _ in range(rng.choice((0, 1, 1, 2, 3, 8))):
        at = rng.randrange(len(text) + 1)
        way = rng.randrange(4)
        if way == 0:
            text = text[:at] + rng.choice(_PIECES) + text[at:]
        elif way == 1:
            text = text[:at] + text[at + rng.choice((1, 2, 5, 30)) :]
        elif way == 2:
            other = rng.randrange(len(text) + 1)
            text = text[:at] + text[min(at, other) : max(at, other)] + text[at:]
        else:
            text = text[:at] + text[rng.randrange(len(text) + 1) :]
    return text.encode(rng.choice(("utf-8", "utf-8", "latin-1", "utf-16")), errors="replace")


def _read(name, kind, options, folder):
    """Read a file as a campaign does; accepted numbers are finite, and of one length."""
    if kind == "flight":
        read_flight(folder / name, options)
        return
    table = {"file": name} | options
    aero = {"reference_area_m2": 1.0, "reference_length_m": 1.0, "table": table}
    tree = {
        "motor": {"motor": [{"name": "m", "profile": table}]},
        "aero": {"body": {"b": {"aerodynamics": aero}}},
        "air": {"environment": {"air": table}},
        "initial": {"initial": {"trajectory": table}},
        "mass": {"body": {"b": {"mass_properties": table}}},
        "wind": {"environment": {"wind": {"azimuth_deg": 90.0, "profile": table}}},
    }[kind]
    problems = Problems()
    read_files(tree, Path(folder), problems)
    problems.raise_if_any("fuzz")
    convert_tree(tree, problems)
    problems.raise_if_any("fuzz")
    if kind == "motor" and not math.isfinite(tree["motor"][0].get("thrust_N", 1.0)):
        raise Wrong("a thrust that is not finite was accepted")
    given = {"initial": tree.get("initial"), "mass": tree.get("body", {}).get("b")}.get(kind)
    for key, value in (given or table).items():
        if isinstance(value, list | float) and not _is_finite(value):
            raise Wrong(f"{key} has a number that is not finite")


def read_flight(path, options):
    """Read channels; accepted ones have finite times, that do not fall, and finite values."""
    mapped = [parse_map(text, _COLUMNS) for text in options["maps"]]
    try:
        channels, _ = read_telemetry(path, mapped, _COLUMNS, options["time"])
    except FormatError as error:
        raise InputError(f"{path.name}: {error}") from None
    for column, (times, values) in channels.items():
        if len(times) != len(values) or not np.isfinite([times, values]).all():
            raise Wrong(f"{column} has a number that is not finite")
        if (np.diff(times) < 0.0).any():
            raise Wrong(f"{column} has times that fall")
    return channels


def _is_finite(value):
    if isinstance(value, list):
        return all(map(_is_finite, value))
    return not isinstance(value, float) or math.isfinite(value)
