#!/bin/sh
# @MARK@ slurm. Submits the shots of this folder: sh @FILE@ [options of sbatch]
# Submitted again, it keeps what is valid.
set -eu
meniscus=@COMMAND@
shots='@SHOTS@'
chunks='@CHUNKS@'

# Runs a command, and again if a signal has ended it. 130 is how meniscus ends when it is stopped.
attempt() {
    number=1
    while :; do
        code=0
        "$@" || code=$?
        if [ "$code" -le 128 ] || [ "$code" -eq 130 ] || [ "$number" -ge 3 ]; then
            exit "$code"
        fi
        number=$((number + 1))
        echo "ended by signal $((code - 128)); attempt $number of 3" >&2
    done
}

# The frames of this task of the array.
frames() {
    set -- $chunks
    shift $((SLURM_ARRAY_TASK_ID - 1))
    printf %s "$1"
}

# A task: sh @FILE@ task STEP SHOT
if [ "${1-}" = task ]; then
    shot=$3
    # Not by --output: Slurm would replace percent signs in the folder's path.
    exec >>"farm-log/$2-${SLURM_ARRAY_JOB_ID:-$SLURM_JOB_ID}-${SLURM_ARRAY_TASK_ID:-0}.log" 2>&1
    case $2 in
@RUN@    esac
    echo "unknown step $2" >&2
    exit 2
fi

cd -- "$(dirname -- "$0")"
mkdir -p farm-log
# Options have no blanks, as those of sbatch that name partitions, accounts and times.
options="$*"
# Submits a step: submit STEP SHOT DEPENDENCY [option of sbatch]; prints the number of its job.
submit() {
    step=$1 shot=$2 after=$3 more=${4-}
    number=$(sbatch --parsable --job-name="meniscus-$step" --output=/dev/null --requeue \
        --kill-on-invalid-dep=yes@RESOURCES@ ${after:+"--dependency=$after"} $more $options \
        ./@FILE@ task "$step" "$shot")
    # On clusters of several, a name follows.
    printf '%s\n' "${number%%;*}"
}
last=
for shot in $shots; do
@SUBMIT@    echo "$shot: submitted, last job $verify"
    last=$last:$verify
done
@LAST@
