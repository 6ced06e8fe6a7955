"""Rig files, settings and column maps with a mistake in them: each with what its one line says."""

from pathlib import Path

RIG = (Path(__file__).parent.parent / "data" / "rigs" / "mass_shifter.toml").read_text(encoding="utf-8")
HEAD, PARAMETERS = RIG.split("[parameters]")
TOP = HEAD.split("[noise]")[0]
DEEP = "a = " + "[" * 20_000


def noise(line: str) -> str:
    """The paper's rig with another line of noise."""
    return f"{TOP}[noise]\n{line}\n[parameters]{PARAMETERS}"


def parameter(name: str, entry: str) -> str:
    """The paper's rig with one parameter as given, or added."""
    lines = [line for line in RIG.splitlines() if line.split(" =")[0].strip() != name]
    return "\n".join([*lines, f"{name} = {entry}"]) + "\n"


def curve(lines: str) -> str:
    """The paper's rig with a curve."""
    return f"{RIG}\n[curve]\nequation = 'torque'\nregressor = 'speed'\nfirst = 0\nstep = 1\nvalues = [1.0, 2.0]\n{lines}"


ANY = {
    DEEP: "nested too deeply",
    "a = " + "9" * 5000: "not a TOML file",
    "d = 2024-13-45": "not a TOML file",
    "a = 1\na = 2": "not a TOML file",
    "\x00": "not a TOML file",
    '"\x1b[31m" = 1': r"\\x1b\[31m|not a TOML file",
    "a = '" + "x" * 2_000_000 + "'": "more than 1 MB",
}

RIGS: dict[str, str] = {
    **ANY,
    noise("voltage = nan"): "noise.voltage must be a finite number, got nan",
    noise("voltage = inf"): "noise.voltage must be (a finite number|less than)",
    noise("current = 0"): "noise.current must be greater than 0, got 0",
    noise("current = -1e-3"): "noise.current must be greater than 0",
    noise("position = 'small'"): "noise.position must be a number, got 'small'",
    noise("position = true"): "noise.position must be a number, got True",
    noise("position = [1]"): "noise.position must be a number",
    noise("pressure = 1.0"): "no noise channel 'pressure'",
    noise("voltage = 1" + "0" * 400): "noise.voltage must be a number",
    f"noise = 3\n{TOP}[parameters]{PARAMETERS}": "noise must be a table, got 3",
    f"{TOP}parameters = 3": "parameters must be a table, got 3",
    f"{TOP}parameters = []": "parameters must be a table",
    TOP: "parameters missing",
    parameter("Vmax", "inf"): "parameters.Vmax.value must be a number .* V, got inf",
    parameter("Vmax", "-15.1"): "parameters.Vmax.value must be a number",
    parameter("Vmax", "1" + "0" * 400): "parameters.Vmax.value must be a number",
    parameter("J", "0"): "parameters.J.value must be a number .* kg m.2, got 0",
    parameter("J", "nan"): "parameters.J.value must be a number",
    parameter("J", "-4.7e-7"): "parameters.J.value",
    parameter("Rm", "'20'"): "parameters.Rm.value must be a number, got '20'",
    parameter("Rm", "false"): "parameters.Rm.value must be a number, got False",
    parameter("Rm", "[20.2]"): "parameters.Rm.value must be a number",
    parameter("Rm", "2024-05-17"): "parameters.Rm.value must be a number",
    parameter("Rm", "{ value = 20.2, unit = 3 }"): "parameters.Rm.unit must be a text",
    parameter(
        "Rm", "{ value = 20.2, spread = -0.1 }"
    ): "parameters.Rm.spread must be greater than or equal to 0",
    parameter("Rm", "{ value = 20.2, spread = nan }"): "parameters.Rm.spread must be a finite number",
    parameter("Rm", "{ value = 20.2, std = -1 }"): "parameters.Rm.std must be greater than or equal to 0",
    parameter("Rm", "{ value = 20.2, std = inf }"): "parameters.Rm.std must be a finite number",
    parameter("Rm", "{ value = 20.2, method = 1 }"): "parameters.Rm.method must be a text",
    parameter("Rm", "{}"): "parameters.Rm.value is missing",
    parameter("Km", "0.0"): "parameters.Km.value",
    parameter("D", "0.0"): "parameters.D.value",
    parameter("A", "-1e-4"): "parameters.A.value",
    parameter("coupling", "2.0"): "parameters.coupling.value",
    parameter("stribeck_speed", "0"): "parameters.stribeck_speed.value must be a number above 0",
    parameter("position_period", "0"): "parameters.position_period.value",
    parameter("integrator_limit", "-inf"): "parameters.integrator_limit.value",
    parameter("torque_offset", "inf"): "parameters.torque_offset.value",
    parameter("x_stop_high", "nan"): "parameters.x_stop_high.value",
    parameter("x_stop_high", "-0.01") + "x_stop_low = 0.01\n": "x_stop_low.value must be below",
    parameter("curve_00", "1.0"): "a curve stands in the table",
    curve("directed = 'no'"): "curve.directed must be true or false",
    curve("std = [-1.0, 1.0]"): "curve.std.0 must be greater than or equal to 0",
    curve("std = [1.0]"): "as many std as values",
    curve("unit = 'V'"): "unit must be",
    f"{RIG}\n[curve]\nequation = ['torque']\n": "curve.equation must be a text",
    f"{RIG}\n[curve]\nequation = 'torque'\nregressor = 'speed'\nfirst = nan\nstep = 1\nvalues = [1, 2]": "curve.first",
    f"{RIG}\n[curve]\nequation = 'torque'\nregressor = 'speed'\nfirst = 0\nstep = 0\nvalues = [1, 2]": "step must be above 0",
    f"{RIG}\n[curve]\nequation = 'torque'\nregressor = 'speed'\nfirst = 0\nstep = 1\nvalues = 'x'": "curve.values must be a list",
    f"curve = 3\n{RIG}": "curve must be a table",
    f"drive = 3\n[parameters]{PARAMETERS}": "drive must be a text, got 3",
    f"drive = 'steam'\n[parameters]{PARAMETERS}": "no drive 'steam'",
    f"name = ''\n[parameters]{PARAMETERS}": "name must",
    f"name = 3\n[parameters]{PARAMETERS}": "name must be a text",
    f"source = {{}}\n[parameters]{PARAMETERS}": "source must be a text",
}

SETTINGS: dict[str, str] = {
    **ANY,
    "bank = 3": "bank must be a table",
    "[[bank]]\nrare = 0.1": "bank must be a table",
    "[bank]\nrecovery_rate = -1": "bank.recovery_rate must be greater than or equal to 0, got -1",
    "[bank]\nfault_rate = nan": "bank.fault_rate must be a finite number",
    "[bank]\nfault_rate = inf": "bank.fault_rate must be",
    "[bank]\nfault_rate = '1'": "bank.fault_rate must be a number",
    "[bank]\nfault_rate = true": "bank.fault_rate must be a number",
    "[bank]\naugment = 1": "bank.augment must be true or false",
    "[bank]\nmended = 2": "bank.mended must be less than or equal to 1",
    "[bank]\nglitch_samples = 1.5": "bank.glitch_samples must be a whole number",
    "[bank]\nglitch_samples = -1": "bank.glitch_samples must be greater than or equal to 0",
    "[bank]\ndoubt = 3": "bank.doubt must be a table",
    "[bank]\ndoubt.J = 'x'": "bank.doubt.J must be a number",
    "[bank]\ndiffusion.w = nan": "bank.diffusion.w must be a finite number",
    "[bank]\ndiffusion.w = -1": "bank.diffusion.w must be greater than",
    "[decision]\nisolated = 1.5": "decision.isolated must be less than or equal to 1",
    "[decision]\nwindow_s = -0.1": "decision.window_s must be greater",
}

MAPS: dict[str, str] = {
    **{text: said for text, said in ANY.items() if "\x1b" not in text},
    "columns = []": "columns must be a table",
    "columns.time_s = 3": "columns.time_s: give a header",
    "columns.time_s = ''": "columns.time_s.header must",
    "columns.time_s = { header = 3 }": "columns.time_s.header must be a text",
    "columns.time_s = { unit = 3 }": "columns.time_s.unit must be a text",
    "columns.time_s = { unit = 'h' }": "no unit for time_s 'h'",
    "columns.time_s = { factor = nan }": "columns.time_s.factor must be a finite number",
    "columns.time_s = { factor = inf }": "columns.time_s.factor must be",
    "columns.time_s = { factor = -1 }": "columns.time_s.factor must be a number above 0",
    "columns.current_a = { factor = 0 }": "columns.current_a.factor must be a number other than 0",
    "columns.current_a = { factor = 1e300 }": "columns.current_a.factor must be less than",
    "columns.current_a = { factor = true }": "columns.current_a.factor must be a number",
    "columns.current_a = { factor = 1" + "0" * 400 + " }": "columns.current_a.factor must be a number",
    "limits.current_a = 0": "limits.current_a must be greater than 0",
    "limits.current_a = -5": "limits.current_a must be greater than 0",
    "limits.current_a = inf": "limits.current_a must be",
    "limits.current_a = []": "limits.current_a must be a number",
    "limits = 3": "limits must be a table",
    "separator = ''": "separator must be one character",
    "separator = '.'": "no part of a number",
    "separator = '1'": "no part of a number",
    "separator = '\"'": "no part of a number",
    'separator = "\\n"': "no part of a number",
    "separator = '§'": "separator must be one character",
    "separator = 3": "separator must be a text",
    "decimal_comma = 'yes'": "decimal_comma must be true or false",
    "header_line = -1": "header_line must be greater than or equal to 0",
    "header_line = 1.0": "header_line must be a whole number",
    "header_line = 1000000000": "header_line must be less than or equal to",
    "data_line = 1": "data_line must come after the header line",
    "missing = [3]": "missing.0 must be a text",
    "missing = ['']": "missing.0 must",
    **{
        f"encoding = '{name}'": "there is no encoding"
        for name in (
            "rot13",
            "base64",
            "hex",
            "zip",
            "punycode",
            "idna",
            "undefined",
            "unicode_escape",
            "",
            "utf 99",
            "../x",
        )
    },
    'encoding = "a\\u0000b"': "there is no encoding",
    "encoding = 8": "encoding must be a text",
}
