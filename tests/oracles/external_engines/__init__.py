"""Other people's engines fly our cases: Exudyn, heyoka and Pinocchio, each with its own equations
of motion and joints.

Only the case, as plain numbers, goes in, and only the formulas of the loads are ours, written here
a second time: nothing of `sepmc.physics` is imported. ``pip install '.[peers]'`` brings the
engines; `compare` stands their flights beside ours.
"""
