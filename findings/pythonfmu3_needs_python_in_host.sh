#!/usr/bin/env bash
# pythonfmu3 0.3.4 (pythonfmu 0.7.0 too): the Linux library of an FMU that it builds uses some 40
# symbols of Python and names no library that has them. It loads in a host that is Python itself
# (FMPy 0.3.32, where the FMU is valid and runs); any other host gets "undefined symbol".
# Seen with Python 3.11 and glibc. Binaries are for x86-64 Linux and Windows.
# Remedy: LD_PRELOAD of the libpython of the machine, or a table of the results in place of an FMU.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
cat >"$work/slave.py" <<'PY'
from pythonfmu3 import Fmi3Causality, Fmi3Slave, Fmi3Variability, Float64


class Ramp(Fmi3Slave):
    def __init__(self, **kwargs):
        super().__init__(**kwargs)
        self.time = self.y = 0.0
        self.register_variable(
            Float64(
                "time",
                causality=Fmi3Causality.independent,
                variability=Fmi3Variability.continuous,
            )
        )
        self.register_variable(Float64("y", causality=Fmi3Causality.output))

    def do_step(self, current_time, step_size):
        self.y = 2.0 * (current_time + step_size)
        return True
PY
cat >"$work/host.c" <<'C'
#include <dlfcn.h>
#include <stdio.h>
int main(int count, char **names) {
    void *library = count > 1 ? dlopen(names[1], RTLD_NOW) : NULL;
    puts(library ? "loaded" : dlerror());
    return library == NULL;
}
C
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet pythonfmu3==0.3.4 fmpy==0.3.32
cd "$work"
"$work/venv/bin/pythonfmu3" build -f slave.py
"$work/venv/bin/python" - <<'PY'
import fmpy
from fmpy.validation import validate_fmu

assert validate_fmu("Ramp.fmu") == []
result = fmpy.simulate_fmu("Ramp.fmu", stop_time=1.0, output_interval=0.25)
assert abs(result["y"][-1] - 2.0) < 1e-12
print("in Python: valid, y(1) =", result["y"][-1])
PY
python3 -m zipfile -e Ramp.fmu content
cc host.c -o host -ldl
if text=$(./host "$work/content/binaries/x86_64-linux/Ramp.so"); then
    echo "loads in a host without Python: no longer as described"
    exit 1
fi
echo "in C: $text" | sed "s|$work/||"
grep -q "undefined symbol: _\?Py" <<<"$text"
