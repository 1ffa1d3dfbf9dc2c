#!/usr/bin/env bash
# numba 0.68.1, llvmlite 0.50.0 (LLVM 22.1), x86-64 with AVX2: a loop over few elements, whose number
# is known when it is compiled, is not vectorised; the same loop over more elements, or over a number
# that is an argument, is. LLVM unrolls loops of up to some hundred instructions before it looks for
# loops to vectorise, and what is unrolled stays scalar: 32 square roots one by one, 64 in packs.
# NUMBA_SLP_VECTORIZE=1, which is meant for straight code, does not help in Numba.
# Seen, as (packed, scalar) square roots of Numba's code: 8 elements (0, 8), 32 elements (0, 32), 64
# elements packed, number as an argument packed; by llvmlite alone, 8 elements (0, 8), and with the
# metadata llvm.loop.unroll.disable on the loop packed, (1, 0) or more.
# Remedy: with llvmlite, that metadata on the branch back; with Numba, hand the number in as an argument.
set -euo pipefail
work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
python3 -m venv "$work/env"
"$work/env/bin/pip" install --quiet numba==0.68.1 llvmlite==0.50.0 numpy==2.4.6
cat >"$work/run.py" <<'PY'
import math
import re

import numba
from llvmlite import binding


def roots(assembly: str) -> tuple[int, int]:
    return len(re.findall(r"\tv?sqrtpd", assembly)), len(re.findall(r"\tv?sqrtsd", assembly))


def by_numba(count: int) -> tuple[int, int]:
    @numba.njit("void(f8[::1], f8[::1])")
    def work(a, b):
        for i in range(count):
            b[i] = math.sqrt(a[i] * a[i] + 1.0)

    return roots(next(iter(work.inspect_asm().values())))


@numba.njit("void(f8[::1], f8[::1], i8)")
def of_any_number(a, b, count):
    for i in range(count):
        b[i] = math.sqrt(a[i] * a[i] + 1.0)


TEXT = """
define void @work(ptr noalias %a, ptr noalias %b) nounwind {{
start:
  br label %loop
loop:
  %i = phi i64 [ 0, %start ], [ %next, %loop ]
  %p = getelementptr double, ptr %a, i64 %i
  %x = load double, ptr %p
  %s = call double @llvm.sqrt.f64(double %x)
  %q = getelementptr double, ptr %b, i64 %i
  store double %s, ptr %q
  %next = add nuw nsw i64 %i, 1
  %done = icmp eq i64 %next, 8
  br i1 %done, label %end, label %loop{mark}
end:
  ret void
}}
declare double @llvm.sqrt.f64(double)
!0 = distinct !{{!0, !1}}
!1 = !{{!"llvm.loop.unroll.disable"}}
"""


def by_llvmlite(mark: str) -> tuple[int, int]:
    target = binding.Target.from_triple("x86_64-unknown-linux-gnu")
    machine = target.create_target_machine(cpu="haswell", opt=3)
    module = binding.parse_assembly(TEXT.format(mark=mark))
    options = binding.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization = True
    builder = binding.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return roots(machine.emit_assembly(module))


binding.initialize_all_targets()
binding.initialize_all_asmprinters()
few, some, many = (by_numba(count) for count in (8, 32, 64))
any_number = roots(next(iter(of_any_number.inspect_asm().values())))
plain, marked = by_llvmlite(""), by_llvmlite(", !llvm.loop !0")
print("numba, 8, 32, 64 elements, number as an argument:", few, some, many, any_number)
print("llvmlite, 8 elements, plain and marked:", plain, marked)
assert few == (0, 8) and some == (0, 32), "short loops of Numba are vectorised"
assert many[0] > 0 and any_number[0] > 0, "long loops of Numba are not vectorised"
assert plain == (0, 8) and marked[0] > 0 and marked[1] == 0, "llvmlite differs"
PY
"$work/env/bin/python" "$work/run.py"
NUMBA_SLP_VECTORIZE=1 "$work/env/bin/python" "$work/run.py" >/dev/null
