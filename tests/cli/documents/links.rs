//! Links of the documents lead to files and headings.

use super::block::{documents, read, root};
use std::path::Path;

/// Targets of the links and pictures of a text, but for those of the web.
fn targets(text: &str) -> impl Iterator<Item = &str> {
    let parts = text.split("](").skip(1).filter_map(|part| part.split_once(')').map(|(target, _)| target));
    parts.filter(|target| !target.contains("://") && !target.contains(char::is_whitespace))
}

/// The name by which links reach a heading.
fn anchor(heading: &str) -> String {
    let kept = heading.trim().chars().filter(|c| c.is_alphanumeric() || "-_ ".contains(*c));
    kept.collect::<String>().to_lowercase().replace(' ', "-")
}

/// What is wrong with a link in a document.
fn fault(document: &str, target: &str) -> Option<String> {
    let (file, heading) = target.split_once('#').map_or((target, None), |(file, name)| (file, Some(name)));
    let folder = Path::new(document).parent()?;
    let path = if file.is_empty() { document.into() } else { folder.join(file) };
    if !root().join(&path).exists() {
        return Some(format!("{document}: {target} is not there"));
    }
    let heading = heading.filter(|_| path.extension().is_some_and(|end| end == "md"))?;
    let text = read(path.to_str()?);
    let mut headings = text.lines().filter(|line| line.starts_with('#'));
    let is_there = headings.any(|line| anchor(line.trim_start_matches('#')) == heading);
    (!is_there).then(|| format!("{document}: {target} names no heading"))
}

#[test]
fn links_lead_to_files_and_headings() {
    let mut count = 0;
    let mut faults = Vec::new();
    for document in documents() {
        for target in targets(&read(&document)) {
            count += 1;
            faults.extend(fault(&document, target));
        }
    }
    assert!(faults.is_empty(), "{}", faults.join("\n"));
    assert!(count > 100, "{count} links");
    // Planted.
    assert!(fault("docs/bodies.md", "images/no-such.jpg").is_some());
    assert!(fault("docs/bodies.md", "liquid.md#no-such-heading").is_some());
    assert!(fault("docs/bodies.md", "#limits").is_none());
}
