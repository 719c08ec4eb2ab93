//! Open Job Description: one template in JSON, which the `openjd` program and Deadline Cloud run.
//!
//! No path is in the template: the folder is a parameter that is the template's own folder unless it is given, so a folder can be
//! moved, and no name needs quotation marks. Braces would be expressions: the only texts are parameters' values, which are not
//! expressions, and words of our own.

use super::job::{FarmJob, JobFiles, MARK, Scope, Step, Word};
use crate::{control::printable, job::RunError};
use serde_json::{Value, json};

/// Characters of a parameter's value.
const MAX_VALUE: usize = 1024;

/// Characters of a job's name.
const MAX_NAME: usize = 128;

/// Time that a task gets to keep its finished frames when it is cancelled [s]; `meniscus` takes four at most.
const NOTICE_SECONDS: u32 = 30;

/// The template, and the command that runs it.
///
/// # Errors
/// If the program's name is longer than a parameter's value may be.
pub(super) fn files(job: &FarmJob) -> Result<JobFiles, RunError> {
    if job.command.chars().count() > MAX_VALUE {
        return Err(RunError::Request(format!(
            "--command: found more than {MAX_VALUE} characters, which a parameter of Open Job Description cannot hold"
        )));
    }
    let name: String = printable(&job.title).chars().take(MAX_NAME).collect();
    let name = if name.trim().is_empty() { "Untitled".to_owned() } else { name };
    let steps: Vec<Value> = job.steps.iter().map(|step| template_of(job, step)).collect();
    let template = json!({
        "specificationVersion": "jobtemplate-2023-09",
        "name": "{{Param.Title}}",
        "description": format!("{MARK} openjd."),
        "parameterDefinitions": [
            { "name": "Title", "type": "STRING", "default": name, "description": "Name of the job." },
            {
                "name": "Folder", "type": "PATH", "objectType": "DIRECTORY", "dataFlow": "INOUT", "default": ".",
                "description": "The shot folder, or the folder of wedges.",
            },
            {
                "name": "Meniscus", "type": "STRING", "default": job.command, "minLength": 1,
                "description": "The program on the machines that run the tasks.",
            },
        ],
        "steps": steps,
    });
    let text = serde_json::to_string_pretty(&template).expect("a template is plain data") + "\n";
    let last = &job.steps.last().expect("a job has steps").name;
    let submit =
        format!("openjd run {FILE} --step {last} --run-dependencies, or submit the folder as a job bundle");
    Ok(JobFiles { files: vec![(FILE, text)], submit })
}

/// Name of the template.
const FILE: &str = "farm.openjd.json";

/// A step of the template.
fn template_of(job: &FarmJob, step: &Step) -> Value {
    let word = |word: &Word| match word {
        Word::Plain(text) => text.clone(),
        Word::Shot => folder(job),
        Word::Preset => folder(job) + "/preset.toml",
        Word::Chunk => "{{Task.Param.Frames}}".into(),
        Word::Root => "{{Param.Folder}}".into(),
    };
    let words = step.words.iter().map(word).chain(job.common_words());
    let words: Vec<String> = words.chain(["--progress".into(), "openjd".into()]).collect();
    let cancelation = json!({ "mode": "NOTIFY_THEN_TERMINATE", "notifyPeriodInSeconds": NOTICE_SECONDS });
    let run = json!({ "command": "{{Param.Meniscus}}", "args": words, "cancelation": cancelation });
    let mut template = json!({ "name": step.name, "script": { "actions": { "onRun": run } } });
    let before: Vec<Value> =
        job.before(step.stage).into_iter().map(|step| json!({ "dependsOn": step.name })).collect();
    if !before.is_empty() {
        template["dependencies"] = before.into();
    }
    let list = |name: &str, values: &[String]| json!({ "name": name, "type": "STRING", "range": values });
    let shots = (step.scope != Scope::All && !job.shots.is_empty()).then(|| list("Shot", &job.shots));
    let chunks = (step.scope == Scope::Chunk).then(|| list("Frames", &job.chunks));
    let parameters: Vec<Value> = shots.into_iter().chain(chunks).collect();
    if !parameters.is_empty() {
        template["parameterSpace"] = json!({ "taskParameterDefinitions": parameters });
    }
    let threads = (job.threads > 0).then(|| json!({ "name": "amount.worker.vcpu", "min": job.threads }));
    let memory = job.reserved_mebibytes().map(|mib| json!({ "name": "amount.worker.memory", "min": mib }));
    let amounts: Vec<Value> = threads.into_iter().chain(memory).collect();
    if !amounts.is_empty() {
        template["hostRequirements"] = json!({ "amounts": amounts });
    }
    template
}

/// The folder of the task's shot.
fn folder(job: &FarmJob) -> String {
    if job.shots.is_empty() {
        "{{Param.Folder}}".into()
    } else {
        "{{Param.Folder}}/{{Task.Param.Shot}}".into()
    }
}
