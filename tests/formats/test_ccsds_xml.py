"""OEM and AEM in XML against the same messages in keyword = value notation."""

import pytest

from sepmc.formats.ccsds import read_initial
from sepmc.formats.ccsds_messages import parse_message
from sepmc.formats.text_table import FormatError

STATE = ("X", "Y", "Z", "X_DOT", "Y_DOT", "Z_DOT", "X_DDOT", "Y_DDOT", "Z_DDOT")
ROWS = [(0, 6500.0, 1.0, 2.0, 0.1, 2.0, 0.3), (9, 6500.9, 19.0, 4.7, 0.1, 2.0, 0.3)]
METADATA = {"OBJECT_NAME": "STAGE", "CENTER_NAME": "EARTH", "REF_FRAME": "EME2000"}
TURNED = {"REF_FRAME_A": "EME2000", "REF_FRAME_B": "SC_BODY_1", "ATTITUDE_DIR": "A2B"}
EPOCH = "2026-03-01T00:00:03"


def epoch(second):
    return f"2026-03-01T00:00:{second:02d}"


def elements(pairs):
    return "".join(f"<{tag}>{value}</{tag.split()[0]}>" for tag, value in pairs)


def xml(kind, metadata, states, version="2.0"):
    return (
        f'<?xml version="1.0" encoding="UTF-8"?>\n<{kind} id="CCSDS_{kind.upper()}_VERS" '
        f'version="{version}"><header><ORIGINATOR>ME</ORIGINATOR></header><body><segment>\n'
        f"<metadata>{elements(metadata.items())}</metadata>\n<data><COMMENT>rows</COMMENT>\n"
        + "\n".join(states)
        + f"</data></segment></body></{kind}>"
    )


def kvn(kind, metadata, rows, version="2.0"):
    lines = [f"CCSDS_{kind.upper()}_VERS = {version}", "META_START"]
    lines += [f"{key} = {value}" for key, value in metadata.items()] + ["META_STOP"]
    return "\n".join([*lines, *(f"{epoch(t)} " + " ".join(map(str, row)) for t, *row in rows)])


def oem_states(rows, unit=""):
    for second, *row in rows:
        pairs = [("EPOCH", epoch(second))]
        pairs += [(f"{tag}{unit if tag in 'XYZ' else ''}", x) for tag, x in zip(STATE, row)]  # noqa: B905
        yield f"<stateVector>{elements(pairs)}</stateVector>"


def test_states_are_those_of_the_other_notation():
    longer = [(*row, 0.1, 0.2, 0.3) for row in ROWS]
    for rows, unit in ((ROWS, ""), (ROWS, ' units="km"'), (longer, "")):
        text = xml("oem", METADATA, [*oem_states(rows, unit), "<covarianceMatrix/>"])
        version, segments = parse_message(text, "OEM")
        other_version, others = parse_message(kvn("oem", METADATA, rows), "OEM")
        assert version == other_version
        assert [(x.metadata, x.epochs, x.rows) for x in segments] == [
            (x.metadata, x.epochs, x.rows) for x in others
        ]


def attitude_states(kind, rows):
    for second, *row in rows:
        if kind == "QUATERNION":  # named, so the scalar part may stand anywhere
            pairs = zip(("QC", "Q1", "Q2", "Q3"), row, strict=True)
            inner = f"<quaternion>{elements(pairs)}</quaternion>"
        elif kind == "EULER_ANGLE":
            inner = elements(zip(("ANGLE_1", "ANGLE_2", "ANGLE_3"), row, strict=True))
        else:  # of version 1
            tags = [f'rotation{k} angle="{axis}_ANGLE"' for k, axis in enumerate("ZYX", 1)]
            inner = f"<rotationAngles>{elements(zip(tags, row, strict=True))}</rotationAngles>"
            inner += '<rotationRates><rotation1 rate="Z_RATE">7</rotation1></rotationRates>'
        tag = "quaternionState" if kind == "QUATERNION" else "eulerAngle"
        time = elements([("EPOCH", epoch(second))])
        yield f"<attitudeState><{tag}>{time}{inner}</{tag}></attitudeState>"


@pytest.mark.parametrize(
    ("kind", "extra", "rows"),
    [
        ("QUATERNION", {"QUATERNION_TYPE": "FIRST"}, [(0, 1, 0, 0, 0), (9, 0.8, 0, 0.6, 0)]),
        ("EULER_ANGLE", {"EULER_ROT_SEQ": "321"}, [(0, 10, 20, 30), (9, 11, 22, 33)]),
        ("EULER_ANGLE/RATE", {"EULER_ROT_SEQ": "321"}, [(0, 10, 20, 30), (9, 11, 22, 33)]),
    ],
)
def test_attitudes_are_those_of_the_other_notation(tmp_path, kind, extra, rows):
    metadata = TURNED | {"ATTITUDE_TYPE": kind} | extra
    (tmp_path / "s.oem").write_text(xml("oem", METADATA, oem_states(ROWS)))
    results = []
    states = attitude_states(kind, rows)
    for text in (xml("aem", metadata, states, "1.0"), kvn("aem", metadata, rows, "1.0")):
        (tmp_path / "s.aem").write_text(text)
        attitude = {"file": str(tmp_path / "s.aem"), "axes": "forward-right-down"}
        keys, _ = read_initial(tmp_path / "s.oem", {"epoch": EPOCH, "attitude": attitude})
        results.append(keys)
    assert results[0] == results[1]


def test_message_within_an_ndm():
    message = xml("oem", METADATA, oem_states(ROWS)).partition("\n")[2]
    assert len(parse_message(f"<ndm><opm/>{message}</ndm>", "OEM")[1]) == 1
    with pytest.raises(FormatError, match="<ndm> has 2 messages <oem>"):
        parse_message(f"<ndm>{message}{message}</ndm>", "OEM")


@pytest.mark.parametrize(
    ("kind", "replace", "reason"),
    [
        ("oem", ("<?xml", "<!DOCTYPE oem [<!ENTITY x 'y'>]><?xml"), "line 1: has entities"),
        ("oem", ("oem", "opm"), "<opm> has no message <oem>"),
        ("oem", (' version="2.0"', ""), "<oem> has no version"),
        ("oem", ("<Z>4.7</Z>", ""), "line 6: <stateVector> has no <Z>"),
        ("oem", ("<Z>4.7</Z>", "<Z>4.7</Z><Z>4.8</Z>"), "<stateVector> has 2 elements <Z>"),
        ("oem", ("<Z>4.7</Z>", '<Z units="m">4700</Z>'), "<Z> is in 'm'; must be km"),
        ("oem", ("<Z>4.7</Z>", "<Z>4,7</Z>"), "line 6: .* is no row of numbers"),
        ("oem", ("stateVector", "state"), "has no segment with rows"),
        ("aem", ("EULER_ANGLE", "SPIN"), "segment at line 2: ATTITUDE_TYPE is 'SPIN'"),
        ("aem", ('"Z_ANGLE"', '"X_ANGLE"'), "<rotation1> has angle = 'X_ANGLE', but EULER"),
    ],
)
def test_faults_are_named(kind, replace, reason):
    states = oem_states(ROWS)
    metadata = METADATA
    if kind == "aem":
        metadata = TURNED | {"ATTITUDE_TYPE": "EULER_ANGLE", "EULER_ROT_SEQ": "321"}
        states = attitude_states("EULER_ANGLE/RATE", [(0, 1, 2, 3), (9, 1, 2, 3)])
    text = xml(kind, metadata, states).replace(*replace)
    with pytest.raises(FormatError, match=reason):
        parse_message(text, kind.upper())
