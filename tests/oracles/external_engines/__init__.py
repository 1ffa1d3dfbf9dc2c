"""Cases simulated by other engines: Exudyn, heyoka and Pinocchio, each with its own equations of
motion and joints.

They receive the case as plain numbers. Only the formulas of the loads are ours, written here a
second time: nothing of `sepmc.physics` is imported. ``pip install '.[peers]'`` installs the
engines; `compare` compares their results with those of the engine.
"""
