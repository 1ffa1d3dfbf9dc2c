"""Compilation of compile units, the functions of a kernel that are compiled separately: from their
Python source, translated here, by LLVM to object files."""

import ast
from functools import cache

from llvmlite import binding

from sepmc.code_cache import features, processor
from sepmc.translator.module import Module
from sepmc.translator.sources import unit_source

ENTRY = "entry"  # name of the function of every compile unit


def compile_text(text: str, symbol: str) -> bytes:
    """Compile a compile unit to an object file.

    Parameters
    ----------
    text : str
        Python source of a module with a function of the name `ENTRY` ("entry"), decorated with
        `units.compile_unit` (`sepmc.kernel.emit.compile_units` writes it).
    symbol : str
        Name of that function in the object file.

    Returns
    -------
    bytes
        Content of the object file, for the processor of `target_machine`.
    """
    return target_machine().emit_object(optimised(assembly(text, symbol)))


def assembly(text: str, symbol: str) -> str:
    """Translate a compile unit to the text of a module in LLVM assembly, not optimised.

    ``text`` is its Python source with the function ``entry``, and ``symbol`` the name that this
    function has in the module, as in `compile_text`.
    """
    source, module = unit_source(text, ENTRY), Module()
    mark = source.node.decorator_list[0]
    assert isinstance(mark, ast.Call)
    module.entry(source, symbol, ast.literal_eval(mark.args[0]))
    return module.text()


@cache
def target_machine() -> binding.TargetMachine:
    """Return LLVM's code generator for the processor named in `sepmc.code_cache`; every call
    returns the same object."""
    binding.initialize_native_target()
    binding.initialize_native_asmprinter()
    target = binding.Target.from_default_triple()
    reloc = "static" if target.name.startswith("x86") else "default"
    return target.create_target_machine(
        cpu=processor(), features=features(), opt=3, reloc=reloc, codemodel="jitdefault", jit=True
    )


def optimised(text: str) -> binding.ModuleRef:
    """Parse a module in LLVM assembly, verify it and optimise it for the processor of
    `target_machine`; return the module. Raises RuntimeError if the assembly is not valid."""
    machine = target_machine()
    module = binding.parse_assembly(text)
    module.triple = binding.get_process_triple()
    module.data_layout = str(machine.target_data)
    module.verify()
    options = binding.create_pipeline_tuning_options(speed_level=3)
    options.loop_vectorization, options.slp_vectorization = True, False
    builder = binding.create_pass_builder(machine, options)
    builder.getModulePassManager().run(module, builder)
    return module
