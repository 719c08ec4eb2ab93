//! Slurm: one shell script, which submits itself.
//!
//! No path is in the script: jobs start in its folder, and use relative names. The chunks of a shot are the tasks of an array. A
//! task that a signal has ended, for lack of memory or on a failing machine, runs again twice; `--requeue` is for machines that
//! are lost.

use super::job::{FarmJob, JobFiles, MARK, Scope, Step, Word};

/// Name of the script.
const FILE: &str = "farm.slurm.sh";

/// The script, and the command that submits it.
pub(super) fn files(job: &FarmJob) -> JobFiles {
    let shots = if job.shots.is_empty() { ".".into() } else { job.shots.join(" ") };
    let script = TEMPLATE
        .replace("@MARK@", MARK)
        .replace("@FILE@", FILE)
        .replace("@CHUNKS@", &job.chunks.join(" "))
        .replace("@SHOTS@", &shots)
        .replace("@RESOURCES@", &resources(job))
        .replace("@RUN@", &job.steps.iter().map(|step| case(job, step)).collect::<String>())
        .replace("@SUBMIT@", &submission(job))
        .replace("@LAST@\n", &last_submission(job))
        // Last: a name may have any text.
        .replace("@COMMAND@", &quoted(&job.command));
    let submit = format!("sh {FILE}; options of sbatch may follow, such as --partition=short");
    JobFiles { files: vec![(FILE, script)], submit }
}

/// The script but for what differs between jobs.
const TEMPLATE: &str = include_str!("slurm.sh");

/// Options of `sbatch` for what a task needs.
fn resources(job: &FarmJob) -> String {
    let threads = (job.threads > 0).then(|| format!(" --cpus-per-task={}", job.threads));
    let memory = job.reserved_mebibytes().map(|mib| format!(" --mem={mib}M"));
    threads.into_iter().chain(memory).collect()
}

/// The branch of a task of a step.
fn case(job: &FarmJob, step: &Step) -> String {
    let word = |word: &Word| match word {
        Word::Plain(text) => quoted(text),
        Word::Shot => "\"$shot\"".into(),
        Word::Preset => "\"$shot/preset.toml\"".into(),
        Word::Chunk => "\"$(frames)\"".into(),
        Word::Root => ".".into(),
    };
    let words: Vec<String> = step.words.iter().map(word).chain(job.common_words()).collect();
    format!("    {}) attempt \"$meniscus\" {} --progress plain ;;\n", step.name, words.join(" "))
}

/// The lines that submit the steps of a shot.
fn submission(job: &FarmJob) -> String {
    let variable = |step: &Step| step.name.replace('-', "_");
    let mut lines = String::new();
    for step in job.steps.iter().filter(|step| step.scope != Scope::All) {
        let before = job.before(step.stage).into_iter().map(|step| format!(":${}", variable(step)));
        let before: String = before.collect();
        let after = if before.is_empty() { String::new() } else { format!("afterok{before}") };
        let array = if step.scope == Scope::Chunk {
            format!(" --array=1-{}", job.chunks.len())
        } else {
            String::new()
        };
        lines += &format!("    {}=$(submit {} \"$shot\" \"{after}\"{array})\n", variable(step), step.name);
    }
    lines
}

/// The lines that submit the steps of all shots, which run however the shots have ended.
fn last_submission(job: &FarmJob) -> String {
    let steps = job.steps.iter().filter(|step| step.scope == Scope::All);
    let line = |step: &Step| {
        format!("{0}=$(submit {0} . \"afterany$last\")\necho \"{0}: submitted, job ${0}\"\n", step.name)
    };
    steps.map(line).collect()
}

/// A text as a shell takes it for one word.
fn quoted(text: &str) -> String {
    format!("'{}'", text.replace('\'', "'\\''"))
}
