"""Accurate and flagged lines of every stress, in the form of `sepmc.validation.stresses.expected`:
``python tests/measure/stress_counts.py`` (two to five minutes)."""

from sepmc.validation import stress

if __name__ == "__main__":
    for name in stress.STRESSES:
        accurate, flagged = stress.counts(stress.stress([name]))
        print(f'    "{name}": ({accurate}, {flagged}),', flush=True)
