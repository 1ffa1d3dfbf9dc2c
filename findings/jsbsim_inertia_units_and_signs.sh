#!/usr/bin/env bash
# JSBSim 1.3.3: inertia given in KG*M2 comes out 9.0e-5 too small (its factor to SLUG*FT2 is that of
# 1.35594 kg m2; 14.593903 kg x 0.3048^2 m2 are 1.3558179), and the products of inertia that it
# shows as properties mix their signs: inertia/ixy and inertia/iyz are the positive integrals in body
# axes (forward, right, down), inertia/ixz is the entry of the tensor, the negative integral.
# Seen with Python 3.11: a body with the entries (xy, xz, yz) = (-2, 60, 17) kg m2 of its
# tensor in structural axes (aft, right, up) has (2, 60, -17) in body axes, shown as -2, 60, 17.
# Remedy: give SLUG*FT2; take the tensor of the model, or turn the signs of ixy and iyz only.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
mkdir "$work/t"
cat >"$work/t/t.xml" <<'XML'
<?xml version="1.0"?>
<fdm_config name="t" version="2.0" release="ALPHA">
<fileheader/>
<metrics>
<wingarea unit="M2"> 10 </wingarea><wingspan unit="M"> 5 </wingspan><chord unit="M"> 2 </chord>
<location name="AERORP" unit="M"><x>0</x><y>0</y><z>0</z></location>
<location name="EYEPOINT" unit="M"><x>0</x><y>0</y><z>0</z></location>
<location name="VRP" unit="M"><x>0</x><y>0</y><z>0</z></location>
</metrics>
<mass_balance>
<ixx unit="KG*M2"> 70 </ixx><iyy unit="KG*M2"> 205 </iyy><izz unit="KG*M2"> 212 </izz>
<ixy unit="KG*M2"> -2 </ixy><ixz unit="KG*M2"> 60 </ixz><iyz unit="KG*M2"> 17 </iyz>
<emptywt unit="KG"> 300 </emptywt>
<location name="CG" unit="M"><x>1</x><y>0</y><z>0</z></location>
</mass_balance>
<ground_reactions/><propulsion/><flight_control name="f"/><aerodynamics/>
</fdm_config>
XML
cat >"$work/run.py" <<'PY'
import sys

import jsbsim

fdm = jsbsim.FGFDMExec(None)
fdm.set_debug_level(0)
fdm.set_aircraft_path(sys.argv[1])
fdm.load_model("t")
fdm.run_ic()
slug_ft2 = 14.593902937206364 * 0.3048**2  # kg m2, of the pound and the foot as defined
shown = {k: fdm[f"inertia/{k}-slugs_ft2"] * slug_ft2 for k in ("ixx", "ixy", "ixz", "iyz")}
print("properties, kg m2:", {k: round(v, 5) for k, v in shown.items()})
assert abs(shown["ixx"] / 70.0 - (1.0 - 9.0e-5)) < 1e-6, "the unit"
assert shown["ixy"] < 0.0 < shown["iyz"], "positive integrals: the entries are +2 and -17"
assert shown["ixz"] > 0.0, "the entry: the integral is -60"
PY
python3 -m venv "$work/venv"
"$work/venv/bin/pip" install --quiet jsbsim==1.3.3 numpy
"$work/venv/bin/python" "$work/run.py" "$work"
