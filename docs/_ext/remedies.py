"""Remedies of messages, by a pattern of the message; every message of their kinds has one."""

# warnings before a run and notes of a run
OF_NOTES = {
    r"is it in another unit\?|is the unit right\?|are both units right\?": "check the unit of the "
    "key, such as `cg_mm` for `cg_m`",
    r"with relative = true": "a width in the unit of the key was probably meant as a fraction: add "
    "`relative = true`, or change the width",
    r"can hold its bodies still": "`return_factor = 1`, forces of at least 0, or `push_only`",
    r"the weights add up to": "they are normalised; change them if that is not meant",
    r"does not allow, and are not run": "bound the distribution with `truncate_sigma`",
    r"overlap at the start": "move a station, or give the clearance `after`",
    r"nearly level along its x axis": "give `apart = 1` or `-1`: the sign of the separation is "
    "otherwise decided by a few millimetres",
    r"is it the other way round": "turn the axis of the spring, or the sign of its force",
    r"pulls with .* before its stroke": "shorten the stroke, raise the force, or give "
    "`push_only = true`; a spring that fails has `factor = 0`",
    r"but the flight begins at": "add rows of the wind up to the flight, or a last one of speed 0",
    r"so a case that turns below it": "`mirror`, or a deck with rows on both sides",
    r"does nothing|there is no thrust before": "give the key that is missing, or remove the entry",
    r"has no stroke_m, so its stroke": "give the stroke, or another condition",
    r"comes after the end of the run": "give a longer `run.end_time_s`, or an earlier time",
    r"is never released|is free in all phases": "give the release, or remove the output",
    r"constraint rows are redundant": "the motion is unique; use other kinds of joint if their "
    "loads matter",
    r"give more rows where it changes": "add rows to the table where its values change fast, or "
    'give `interpolation = "monotone"` or `"linear"`: a cubic spline overshoots where distances '
    "between rows differ much",
    r"is it in the other unit": "check whether the key ends in `_deg` or `_rad`",
    r"of sigma = .* which is far too large": "compare sigma with the noise that `sepmc compare RUN "
    "--data` prints of the channel, and its unit with that of the column",
    r"the sampler mixes badly": "two seeds that agree suffice; else more `--cases`, or constants "
    "in place of distributions of parameters in the list *hardly known better*",
    r"is it per degree": 'give the slope per rad, or `per = "deg"` beside it',
    r"is pushed down: does it point down|pushes this body forward": "change the sign of the "
    "coefficient, in a file by `columns = { normal = { column = NAME, scale = -1 } }`",
    r"points left here": 'change the sign of `side`, or give `convention = "datcom"`',
    r"statically stable in alpha": "check the signs of `side` and `yaw`, and `moment_point_m`",
    r"is the table transposed": "nest the lists of the table in the order mach, alpha, beta: the "
    "outermost list has a row for each value of the first axis given",
    r"are they reversed": "count stations from the nose, positive aft",
    r"mirrored they would have the other": "change the signs of the named products of inertia of "
    "one body",
    r"is shorter than build_up_s": "check both times: `build_up_s` is the time constant of the "
    "rise of thrust, not its duration",
    r"applies to the nominal case only": "set the distribution instead: `--set dispersion.KEY=...`",
    r"the nominal case has no|the nominal case violates it": "check the bound of the requirement "
    "and its unit; if both are right, most cases will violate it",
    r"should separate": "turn an axis of the joint or of a spring, or set `apart`",
    r"toward the other": "`cant_deg` of the motor is probably reversed",
    r"outcomes that wait for it|KEY in the nominal case": "nothing if a failure is "
    "dispersed, else look at a case in which it happens: `sepmc replay`",
    r"is smallest when": "give a longer `run.end_time_s`: the minimum may come later",
    r"rows of the table are independent|only cases NUMBERS|are a part of a design": "for intervals "
    "and verdicts, run random cases, from the first on",
    r"run\.sampler = ": 'for verdicts on requirements use `sampler = "random"`',
    r"balanced after a power of two": "give a number of cases that is a power of two",
    r"hardly show the effect": "more cases, `sepmc campaign --rare`, or a run of its own with that "
    "value `constant`",
    r"stopped after": "look at the failed cases by `status`; `--resume` without `--max-failures` "
    "continues",
    r"several kinds of processor": "nothing, unless rows must agree to the last bit: then use "
    "machines of one kind",
    r"no calibration case reached|numerical error of NAME is not known": "look at the status of "
    "the nominal case: `sepmc run FILE`",
    r"requested accuracy ASKED is not met": "look for what limits the named outcomes: a kink in a "
    "table or load, or a threshold that is only just reached",
    r"did not converge to the requested|a shorter step changes": "nothing if the reported error is "
    "small enough: it includes these cases; else look at them by the columns `status` and `error`",
    r"statistics leave out": "look at the `status` of the cases left out; `sepmc sensitivity RUN` "
    "shows the inputs that distinguish them",
    r"the run is not complete": "`sepmc campaign` with `--resume` runs the missing cases",
    r"the run was made with VERSIONS": "nothing, unless rows must agree to the last bit: then "
    "install the versions that the run was made with",
    r"satisfied by none|none of them has": "give another filter: no case with the status ok "
    "satisfies this one",
    r"nominal case did not reach": "run the nominal case in full, `sepmc run FILE`: a check limits "
    "its work",
    r"can give a case whose|breaks the triangle": "an inertia of no solid body: narrow the "
    "distribution, or correlate the moments",
    r"made by fork": "start processes by spawn or forkserver",
    r"trial chains|replicas disagree|descend from": "give more cases: `--cases 1e6`",
    r"chains hardly move": "give more cases, or look for jumps of the margin: an outcome that "
    "changes by steps",
    r"did not end with status ok": "look at the cases without a result by `status` in "
    "`rare.parquet`; the interval with unknown cases includes them",
    r"the audit failed": "shorten `solver.step_s`, or remove it",
    r"this is not rare": "run a plain campaign, without `--rare`",
    r"nearer to the bound than|two levels lie about as near": "give a smaller `solver.accuracy`",
}

# errors of run folders, tables, workers and paths
OF_FOLDERS = {
    r"is a file|contains other files|exists; add|contains a bench|is a file where": "choose "
    "another `--out`; `--overwrite` replaces a run or a bench, nothing else",
    r"another process writes": "wait until the other process ends; one that was killed leaves no "
    "lock",
    r"free there": "free the disk, or store less: `--stats-only`, `--keep`, a larger "
    "`run.history_step_s`",
    r"cannot be written|cannot be reached|PATH: (ERROR|FAULT)$": "check permissions, disk and "
    "address; object storage needs the extra `cluster`",
    r"again with --overwrite|is no history": "run the case or the campaign again with "
    "`--overwrite`: `sepmc doctor` cannot restore a single case, or statistics without rows that "
    "do not fit",
    r"cannot be repaired|into another folder": "run it again, into another folder",
    r"cannot be read|PROBLEM|has no column|differ in columns|is not there|"
    r"NAME: NAME|LEDGER_LINES|TEXT: ADVICE": "`sepmc doctor RUN` "
    "lists what is damaged, `--repair` restores it",
    r"is no folder of a run": "give a folder that `sepmc campaign` or `Campaign.run` wrote",
    r"hard link|is a link|neither a file nor a folder": "copy the file there: a run folder "
    "contains its own files only",
    r"another version of sepmc": "read it with the version that wrote it (its "
    "manifest names it), or run it again",
    r"with another campaign|with another seed|Latin hypercube|Saltelli design|"
    r"is to be continued|leave some out": "`--resume` needs the same campaign, seed and mode; for "
    "another run choose another `--out`",
    r"estimate": "give an estimate (`--rare`) a folder of its own; its cases become a run by "
    "`--samples RUN/rare.parquet`",
    r"contains no|contains a single case|is a single case": "give the folder of a run of several "
    "cases, written by `sepmc campaign`",
    r"does not contain case|is none of them": "`sepmc stats RUN` shows how many cases there are",
    r"needs all rows": "run again without `--stats-only` or `--keep`, or use `statistics.csv`",
    r"needs a local folder": "give `--out` a local folder",
    r"no such outcome|is yes or no": "`sepmc stats RUN` lists the outcomes",
    r"no longer waits for this worker": "nothing to do: another worker runs these cases",
    r"a worker on NODE": "give `--out` a folder that every machine sees under the same path",
    r"ended every worker": "give workers more memory, or fewer cases at a time (`run.chunk`)",
    r"workers|no Dask scheduler": "start the scheduler or its workers again, then `--resume`",
    r"must be text or a path": "give a string or `pathlib.Path`",
}
