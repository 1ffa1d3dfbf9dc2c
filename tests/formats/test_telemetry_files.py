"""Channels of telemetry from text, Parquet, MATLAB, MDF and TDMS."""

import numpy as np
import pandas as pd
import pytest
from numpy.testing import assert_allclose
from scipy.io import savemat
from support import ended_process

from sepmc.formats import telemetry
from sepmc.formats.telemetry import MappedChannel, parse_map, read_telemetry
from sepmc.formats.text_table import FormatError
from sepmc.scene.messages import InputError

COLUMNS = ["upper_omega_y_deg_s", "upper_axial_acceleration_m_s2", "signal_gain"]
TIME = np.arange(5) * 0.1
RATE = np.array([0.0, 0.1, -0.2, 0.3, 0.5])


def read(path, *maps, time=None):
    return read_telemetry(path, [parse_map(each, COLUMNS) for each in maps], COLUMNS, time)


def csv(tmp_path, header, *columns):
    path = tmp_path / "f.csv"
    rows = [",".join(map(str, row)) for row in zip(*columns, strict=True)]
    path.write_text("\n".join([header, *rows]))
    return path


def test_map_is_an_assignment():
    assert parse_map("upper_omega_y_deg_s=-gyro_z[rad/s]", COLUMNS) == MappedChannel(
        "upper_omega_y_deg_s", "gyro_z[rad/s]", -1.0
    )
    assert parse_map("signal_gain = 2.5e1 * a b", COLUMNS) == MappedChannel(
        "signal_gain", "a b", 25.0
    )


@pytest.mark.parametrize(
    ("text", "reason"),
    [
        ("gyro", "must be COLUMN=CHANNEL"),
        ("gyro_z=upper_omega_y_deg_s", "no column gyro_z of histories"),
        ("signal_gain=0*x", "must be finite and not 0"),
    ],
)
def test_wrong_maps_are_refused(text, reason):
    with pytest.raises(InputError, match=reason):
        parse_map(text, COLUMNS)


def test_sign_factor_and_unit_of_the_title(tmp_path):
    path = csv(tmp_path, "time (ms),gyro_z (rad/s),acc", 1000 * TIME, RATE, RATE)
    channels, understood = read(
        path, "upper_omega_y_deg_s=-gyro_z", "upper_axial_acceleration_m_s2=9.80665*acc"
    )
    time, values = channels["upper_omega_y_deg_s"]
    assert_allclose(time, TIME, atol=1e-15)
    assert_allclose(values, -np.rad2deg(RATE))
    assert_allclose(channels["upper_axial_acceleration_m_s2"][1], 9.80665 * RATE)
    assert "rad/s: 5 samples" in understood[0]
    assert "m/s2, which the file does not say" in understood[1]


def test_unit_of_the_map_counts(tmp_path):
    path = csv(tmp_path, "t,gyro", TIME, RATE)
    assert_allclose(
        read(path, "upper_omega_y_deg_s=gyro[rad/s]")[0]["upper_omega_y_deg_s"][1],
        np.rad2deg(RATE),
    )
    with pytest.raises(FormatError, match="'furlong' is no unit of angular rate"):
        read(path, "upper_omega_y_deg_s=gyro[furlong]")


def test_channels_that_have_the_name_of_a_column_need_no_map(tmp_path):
    path = csv(tmp_path, "time_s,upper_omega_y_rad_s,other", TIME, RATE, RATE)
    channels, _ = read(path)
    assert list(channels) == ["upper_omega_y_deg_s"]
    assert_allclose(channels["upper_omega_y_deg_s"][1], np.rad2deg(RATE))


def test_gaps_are_left_out(tmp_path):
    path = csv(tmp_path, "t,gyro", TIME, ["1", "nan", "", "2", "3"])
    time, values = read(path, "signal_gain=gyro")[0]["signal_gain"]
    assert_allclose(time, TIME[[0, 3, 4]])
    assert_allclose(values, [1.0, 2.0, 3.0])


@pytest.mark.parametrize(
    ("header", "times", "reason"),
    [
        ("clock,gyro", TIME, "no column of time, .* --time .*; the columns are clock, gyro"),
        ("t,gyro", TIME[::-1], "the time falls from 0.4 to 0.3 s in line 3"),
        ("time (fortnight),gyro", TIME, "'fortnight' is no unit of time"),
        ("t,gyroscope", TIME, "no channel 'gyro'; did you mean 'gyroscope'"),
    ],
)
def test_faults_are_named(tmp_path, header, times, reason):
    path = csv(tmp_path, header, times, RATE)
    with pytest.raises(FormatError, match=reason.replace("(", r"\(")):
        read(path, "signal_gain=gyro")


def test_columns_of_text_are_gaps(tmp_path):
    """As loggers write them; a comma is no gap."""
    path = tmp_path / "f.csv"
    path.write_text("ts,id,gyro,note\n0,IMU0,1.5,\n1,IMU0,N/A,x\n2,IMU0,2.5,\n")
    channels, understood = read(path, "signal_gain=gyro", time="ts")
    assert_allclose(channels["signal_gain"], [[0.0, 2.0], [1.5, 2.5]])
    assert "2 samples, 0 to 2 s; 1 more have no number" in understood[0]
    with pytest.raises(FormatError, match="channel id: has 0 samples that are numbers"):
        read(path, "signal_gain=id", time="ts")
    with pytest.raises(FormatError, match="column id: has no number"):
        read(path, "signal_gain=gyro", time="id")
    path.write_text("ts;gyro;id\n0;1,5;a\n1;2,5;b\n")
    with pytest.raises(FormatError, match="line 2: '1,5' has a decimal comma"):
        read(path, "signal_gain=gyro", time="ts")


@pytest.mark.parametrize("channel", ["gyro", "gyro[rad/s]"])
def test_unit_of_a_mapping(tmp_path, channel):
    """A unit that a caller gives is the unit of the channel."""
    pd.DataFrame({"time_s": TIME, "gyro": RATE}).to_csv(tmp_path / "f.csv", index=False)
    mapped = MappedChannel("upper_omega_y_deg_s", channel, unit="rad/s")
    channels, _ = read_telemetry(tmp_path / "f.csv", [mapped], COLUMNS)
    assert_allclose(channels["upper_omega_y_deg_s"][1], np.degrees(RATE))


def test_parquet(tmp_path):
    pd.DataFrame({"time_s": TIME, "gyro": RATE}).to_parquet(tmp_path / "f.parquet")
    channels, _ = read(tmp_path / "f.parquet", "signal_gain=gyro")
    table = pd.DataFrame({"time_s": TIME, "gyro": len(TIME) * ["a"], "speed": RATE})
    table.to_parquet(tmp_path / "texts.parquet")
    with pytest.raises(FormatError, match="channel gyro: has 0 samples that are numbers"):
        read(tmp_path / "texts.parquet", "signal_gain=gyro")
    read(tmp_path / "texts.parquet", "signal_gain=speed")
    assert_allclose(channels["signal_gain"][1], RATE)


def test_matlab_vectors_and_structs_with_their_own_time(tmp_path):
    content = {"t": TIME, "gyro": RATE, "imu": {"time": TIME[:3] + 7.0, "acc": RATE[:3]}}
    savemat(tmp_path / "f.mat", content)
    channels, _ = read(tmp_path / "f.mat", "upper_omega_y_deg_s=gyro", "signal_gain=imu.acc")
    assert_allclose(channels["upper_omega_y_deg_s"], [TIME, RATE])
    assert_allclose(channels["signal_gain"], [TIME[:3] + 7.0, RATE[:3]])


def test_matlab_7_3_has_the_same_structs(tmp_path):
    """HDF5 with a header of MATLAB; vectors are rows there, and texts are numbers."""
    h5py = pytest.importorskip("h5py")
    with h5py.File(tmp_path / "f.mat", "w", userblock_size=512) as file:
        file["t"], file["gyro"], file["imu/time"] = TIME[None], RATE[:, None], TIME[None, :3] + 7.0
        file["imu/acc"], file["name"] = RATE[None, :3], np.array([[70, 71, 72, 73, 74]], np.uint16)
        file["name"].attrs["MATLAB_class"] = np.bytes_("char")
        file["#refs#/t"] = TIME
    data = (tmp_path / "f.mat").read_bytes()
    (tmp_path / "f.mat").write_bytes(b"MATLAB 7.3 MAT-file".ljust(512) + data[512:])
    channels, _ = read(tmp_path / "f.mat", "upper_omega_y_deg_s=gyro", "signal_gain=imu.acc")
    assert_allclose(channels["upper_omega_y_deg_s"], [TIME, RATE])
    assert_allclose(channels["signal_gain"], [TIME[:3] + 7.0, RATE[:3]])
    with pytest.raises(FormatError, match="no channel 'name'"):
        read(tmp_path / "f.mat", "signal_gain=name")


def test_hdf5_reads_nothing_outside_of_the_file(tmp_path):
    h5py = pytest.importorskip("h5py")
    RATE.tofile(tmp_path / "raw")
    with h5py.File(tmp_path / "other.h5", "w") as file:
        file["gyro"] = RATE
    with h5py.File(tmp_path / "f.h5", "w") as file:
        file["t"], file["own"] = TIME, RATE
        file["linked"] = h5py.ExternalLink("other.h5", "gyro")
        raw = [(str(tmp_path / "raw"), 0, h5py.h5f.UNLIMITED)]
        file.create_dataset("raw", (5,), float, external=raw)
        layout = h5py.VirtualLayout((5,), float)
        layout[:] = h5py.VirtualSource(str(tmp_path / "other.h5"), "gyro", (5,))
        file.create_virtual_dataset("virtual", layout)
        file.create_dataset("t2/t", (10**9,), "i1", chunks=True, compression="gzip")
    with pytest.raises(FormatError, match="has more than 25,000,000 numbers"):
        read(tmp_path / "f.h5", "signal_gain=own")
    with h5py.File(tmp_path / "f.h5", "a") as file:
        del file["t2"]
    assert_allclose(read(tmp_path / "f.h5", "signal_gain=own")[0]["signal_gain"], [TIME, RATE])
    for name in ("linked", "raw", "virtual"):
        with pytest.raises(FormatError, match=f"no channel '{name}'"):
            read(tmp_path / "f.h5", f"signal_gain={name}")


def test_names_that_cannot_be_printed(tmp_path):
    """Of a damaged file; control characters of a terminal are none in messages."""
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    data = (tmp_path / "f.mat").read_bytes()
    (tmp_path / "f.mat").write_bytes(data.replace(b"gyro", b"g\x1b[2"))
    with pytest.raises(FormatError, match=r"known here: g\\x1b\[2"):
        read(tmp_path / "f.mat", "signal_gain=nothing")
    pd.DataFrame({"t": TIME, "g\x1b[2": RATE}).to_parquet(tmp_path / "f.parquet")
    with pytest.raises(
        FormatError, match=r"whose name has characters that cannot be printed: g\\x1b\[2"
    ):
        read(tmp_path / "f.parquet", "signal_gain=nothing")


def test_warnings_of_a_library_are_reported(tmp_path, capfd):
    """Not printed: scipy warns of a variable that is there twice."""
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    data = (tmp_path / "f.mat").read_bytes()
    (tmp_path / "f.mat").write_bytes(data + data[128:])
    channels, understood = read(tmp_path / "f.mat", "signal_gain=gyro")
    assert_allclose(channels["signal_gain"], [TIME, RATE])
    assert "the library that reads the file warns: Duplicate variable name" in understood[0]
    assert capfd.readouterr().err == ""


def test_file_whose_library_ends_the_process_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr(telemetry, "_by_library", ended_process.end)
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    with pytest.raises(FormatError, match="the library that reads it crashes"):
        read(tmp_path / "f.mat", "signal_gain=gyro")


def test_file_whose_library_does_not_end_is_refused(tmp_path, monkeypatch):
    """After a time that grows with the size of the file."""
    monkeypatch.setattr(telemetry, "_by_library", ended_process.wait)
    monkeypatch.setattr(telemetry, "_BASE_S", 0.1)
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    with pytest.raises(FormatError, match="takes more than 0 s to read: is it damaged"):
        read(tmp_path / "f.mat", "signal_gain=gyro")


def test_library_that_cannot_be_imported_is_named(tmp_path, monkeypatch):
    monkeypatch.setattr(telemetry, "_prepare", ended_process.lack)
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    with pytest.raises(InputError, match=r"f.mat: needs scipy.io"):
        read(tmp_path / "f.mat", "signal_gain=gyro")


def test_memory_of_a_library_is_limited(tmp_path, monkeypatch):
    monkeypatch.setattr(telemetry, "_by_library", ended_process.fill)
    savemat(tmp_path / "f.mat", {"t": TIME, "gyro": RATE})
    with pytest.raises(FormatError, match="no memory"):
        read(tmp_path / "f.mat", "signal_gain=gyro")


@pytest.mark.parametrize("ending", [".mat", ".h5", ".mf4", ".tdms", ".parquet", ".csv"])
def test_damaged_files_are_refused(tmp_path, ending):
    path = tmp_path / f"f{ending}"
    path.write_bytes(b"\x00\x01damaged" * 40)
    with pytest.raises((FormatError, InputError)):
        read(path, "signal_gain=gyro")


def test_mdf(tmp_path):
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF()
    file.append(asammdf.Signal(RATE, TIME, name="gyro", unit="rad/s"))
    file.append(asammdf.Signal(RATE[:3], TIME[:3] + 7.0, name="acc", unit="m/s2"))
    path = file.save(tmp_path / "f.mf4")
    channels, _ = read(path, "upper_omega_y_deg_s=-gyro", "upper_axial_acceleration_m_s2=acc")
    assert_allclose(channels["upper_omega_y_deg_s"], [TIME, -np.rad2deg(RATE)])
    assert_allclose(channels["upper_axial_acceleration_m_s2"], [TIME[:3] + 7.0, RATE[:3]])


@pytest.mark.parametrize("is_waveform", [True, False])
def test_tdms(tmp_path, is_waveform):
    nptdms = pytest.importorskip("nptdms")
    wave = {"wf_increment": 0.1, "wf_start_offset": 0.0} if is_waveform else {}
    channels = [nptdms.ChannelObject("imu", "gyro", RATE, {"unit_string": "rad/s", **wave})]
    if not is_waveform:
        channels.append(nptdms.ChannelObject("imu", "Time", TIME, {"unit_string": "s"}))
    with nptdms.TdmsWriter(tmp_path / "f.tdms") as writer:
        writer.write_segment(channels)
    result, _ = read(tmp_path / "f.tdms", "upper_omega_y_deg_s=gyro")
    assert_allclose(result["upper_omega_y_deg_s"], [TIME, np.rad2deg(RATE)])


@pytest.mark.parametrize("header", ["time,gyro,acc", "time,gyro,acc\ns,deg/s,1", "#time,gyro,acc"])
def test_rows_with_gaps_before_the_first_full_row_are_no_header(tmp_path, header):
    rows = ["0.0,,", "0.1,1.0,", "0.2,,5.0", "0.3,2.0,6.0"]
    path = tmp_path / "f.csv"
    path.write_text("\n".join([header, *rows]))
    channels, _ = read(path, "upper_omega_y_deg_s=gyro", "signal_gain=acc")
    assert_allclose(channels["upper_omega_y_deg_s"], [[0.1, 0.3], [1.0, 2.0]])
    assert_allclose(channels["signal_gain"], [[0.2, 0.3], [5.0, 6.0]])


def test_a_title_that_occurs_twice_is_refused_only_if_it_is_used(tmp_path):
    path = csv(tmp_path, "time,h,gyro (deg/s),h,gain,gain", TIME, RATE, RATE, RATE, RATE, 2 * RATE)
    channels, _ = read(path, "upper_omega_y_deg_s=gyro")
    assert_allclose(channels["upper_omega_y_deg_s"][1], RATE)
    with pytest.raises(FormatError, match="several channels gain: gain #1, gain #2; give one"):
        read(path, "signal_gain=gain")
    assert_allclose(read(path, "signal_gain=gain #2")[0]["signal_gain"][1], 2 * RATE)
    path = csv(tmp_path, "time,signal_gain,signal_gain", TIME, RATE, RATE)
    with pytest.raises(FormatError, match="two channels for the column signal_gain"):
        read(path)
