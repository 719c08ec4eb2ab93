//! Flamenco: a job type, which is one JavaScript file for all shots, and the submission of this one.
//!
//! Words go to the program as a list, without a shell. Flamenco replaces `{name}` in them by the manager's variables, and there is
//! no escape: paths with braces are refused, by the job type as well.

use super::job::{FarmJob, JobFiles, MAKE, MARK, Scope, Step, Word};
use crate::{control::printable, job::RunError};
use serde_json::json;

/// The job type.
const TYPE: &str = include_str!("flamenco.js");

/// The job type's file, which names it for Flamenco.
const TYPE_FILE: &str = "meniscus.js";

/// The submission.
const FILE: &str = "farm.flamenco.json";

/// The job type, the submission, and the command that submits it.
///
/// # Errors
/// If a path has braces.
pub(super) fn files(job: &FarmJob) -> Result<JobFiles, RunError> {
    let folder = job.root.to_str().expect("the path was checked to be UTF-8");
    for (what, text) in [("the folder", folder), ("--command", &job.command)] {
        if let Some(found) = text.chars().find(|c| "{}".contains(*c) || c.is_control()) {
            return Err(RunError::Request(format!(
                "{what}: found {found:?} in {text:?}, which Flamenco takes for a variable or cannot hold; rename the folder, or \
                 use a link without it"
            )));
        }
    }
    let products: Vec<String> = job.steps.iter().filter(|step| step.stage == MAKE).map(product).collect();
    let submission = json!({
        "name": printable(&job.title),
        "type": TYPE_FILE.trim_end_matches(".js"),
        "priority": 50,
        "submitter_platform": std::env::consts::OS.replace("macos", "darwin"),
        "metadata": { "comment": format!("{MARK} flamenco.") },
        "settings": {
            "folder": folder,
            "shots": job.shots.join(" "),
            "frames": job.frames,
            "chunk_size": job.chunk,
            "products": products.join("; "),
            "options": job.common_words().join(" "),
            "simulate_options": job.max_memory.map_or_else(String::new, |bytes| format!("--max-memory {bytes}B")),
            "meniscus": job.command,
        },
    });
    let text = serde_json::to_string_pretty(&submission).expect("a submission is plain data") + "\n";
    let submit = format!(
        "copy {TYPE_FILE} to the folder `scripts` next to flamenco-manager and restart it once, then: \
         curl -H 'Content-Type: application/json' -d @{FILE} http://MANAGER:8080/api/v3/jobs"
    );
    Ok(JobFiles { files: vec![(TYPE_FILE, TYPE.replace("@MARK@", MARK)), (FILE, text)], submit })
}

/// A step that makes a product, as the setting `products` has it: the verb and its arguments, without folder and frames.
fn product(step: &Step) -> String {
    let words = step.words.iter().filter_map(|word| match word {
        Word::Plain(text) => Some(text.as_str()),
        _ => None,
    });
    let mut words: Vec<&str> = words.collect();
    if let Some(frames) = words.iter().position(|word| *word == "--frames") {
        // Of a step in one task the frames follow.
        words.drain(frames..=frames + usize::from(step.scope == Scope::Shot));
    }
    let once = if step.scope == Scope::Shot { "once " } else { "" };
    format!("{once}{}", words.join(" "))
}
