//! The processor, the memory and the limits of this process.

use super::problem::{Problem, sized};
use crate::{par, simd};
use serde::Serialize;

/// What computes.
#[derive(Debug, Serialize)]
pub(super) struct Processor {
    /// As the system names it; absent where it does not.
    model: Option<String>,
    /// Cores of the machine; absent where the system does not list them.
    cores: Option<usize>,
    /// Threads that a job uses by default.
    threads: usize,
    /// The instructions of the inner loops.
    instructions: &'static str,
}

impl Processor {
    pub(super) fn examine(problems: &mut Vec<Problem>) -> Self {
        let facts = system_text("/proc/cpuinfo").unwrap_or_default();
        let listed = facts.lines().filter(|line| line.starts_with("processor")).count();
        let found = Self {
            model: field(&facts, "model name").map(str::to_owned),
            cores: Some(listed).filter(|&cores| cores > 0),
            threads: par::threads(),
            instructions: simd::instructions(),
        };
        found.judge(problems);
        found
    }

    fn judge(&self, problems: &mut Vec<Problem>) {
        if let Some(cores) = self.cores.filter(|&cores| self.threads < cores) {
            problems.push(Problem::slows(
                format!("a job uses {} threads of {cores}", self.threads),
                "see --threads and MENISCUS_THREADS, and the limits of the container, `taskset` or `cgroup` that this runs in",
            ));
        }
        if self.instructions == simd::SCALAR {
            problems.push(Problem::slows(
                "the inner loops run without vector instructions, which need AVX2",
                "results are the same bytes; choose a machine with AVX2 for long jobs",
            ));
        }
    }

    pub(super) fn line(&self) -> String {
        let cores = self.cores.map_or_else(String::new, |cores| format!(" of {cores} cores"));
        let model = self.model.as_deref().unwrap_or("unknown model");
        format!("processor  {model}; {} threads{cores}; {}", self.threads, self.instructions)
    }
}

/// Main memory \[bytes\]; absent where the system does not report it.
#[derive(Debug, Serialize)]
pub(super) struct Memory {
    total: Option<u64>,
    available: Option<u64>,
    /// What the control group of this process may use.
    group_limit: Option<u64>,
}

/// Less than this, and shots of a million particles do not fit.
const LITTLE_MEMORY: u64 = 2 << 30;

impl Memory {
    pub(super) fn examine(problems: &mut Vec<Problem>) -> Self {
        let facts = system_text("/proc/meminfo").unwrap_or_default();
        let kibibytes = |name| field(&facts, name)?.strip_suffix(" kB")?.trim().parse::<u64>().ok();
        let bytes = |name| kibibytes(name)?.checked_mul(1024);
        let group = system_text("/sys/fs/cgroup/memory.max").and_then(|text| text.trim().parse().ok());
        let found = Self { total: bytes("MemTotal"), available: bytes("MemAvailable"), group_limit: group };
        found.judge(problems);
        found
    }

    fn judge(&self, problems: &mut Vec<Problem>) {
        let usable = self.group_limit.into_iter().chain(self.available).min();
        if let Some(usable) = usable.filter(|&usable| usable < LITTLE_MEMORY) {
            problems.push(Problem::slows(
                format!("{} of memory can be used", sized(usable)),
                "`meniscus plan PRESET` reports what a shot needs; `--max-memory` refuses what needs more",
            ));
        }
    }

    pub(super) fn line(&self) -> String {
        let size = |bytes: Option<u64>| bytes.map_or_else(|| "unknown".into(), sized);
        let group =
            self.group_limit.map_or_else(String::new, |limit| format!(", limited to {}", sized(limit)));
        format!("memory     {} available of {}{group}", size(self.available), size(self.total))
    }
}

/// What this process may take of the system; absent is unlimited or unknown.
#[derive(Debug, Default, Serialize)]
pub(super) struct Limits {
    /// Addressable memory \[bytes\], `ulimit -v`.
    address_space: Option<u64>,
    /// Size of a file \[bytes\], `ulimit -f`.
    file_size: Option<u64>,
    /// Open files, `ulimit -n`.
    open_files: Option<u64>,
    /// Processes and threads of the user, `ulimit -u`.
    processes: Option<u64>,
}

/// Files that a job may have open: one a thread, and a few for its logs and locks.
const FILES: u64 = 128;

/// The largest files of ordinary shots: volumes and meshes of millions of particles.
const LARGE_FILE: u64 = 1 << 30;

impl Limits {
    pub(super) fn examine(problems: &mut Vec<Problem>) -> Self {
        let found = Self::of_process();
        found.judge(problems);
        found
    }

    #[cfg(unix)]
    fn of_process() -> Self {
        use rustix::process::{Resource, getrlimit};
        let limit = |resource| getrlimit(resource).current;
        Self {
            address_space: limit(Resource::As),
            file_size: limit(Resource::Fsize),
            open_files: limit(Resource::Nofile),
            processes: limit(Resource::Nproc),
        }
    }

    #[cfg(not(unix))]
    fn of_process() -> Self {
        Self::default()
    }

    fn judge(&self, problems: &mut Vec<Problem>) {
        if let Some(bytes) = self.address_space {
            problems.push(Problem::slows(
                format!(
                    "`ulimit -v` allows {} of addresses, more than which end a job with exit code 33",
                    sized(bytes)
                ),
                "raise it, or see what `meniscus plan PRESET` reports",
            ));
        }
        if let Some(bytes) = self.file_size.filter(|&bytes| bytes < LARGE_FILE) {
            problems.push(Problem::slows(
                format!("`ulimit -f` allows files of {}", sized(bytes)),
                "raise it: larger frames end a job with exit code 28",
            ));
        }
        if let Some(files) = self.open_files.filter(|&files| files < FILES) {
            problems
                .push(Problem::slows(format!("`ulimit -n` allows {files} open files"), "raise it to 256"));
        }
        let threads = par::threads() as u64;
        if let Some(count) = self.processes.filter(|&count| count < threads + 64) {
            problems.push(Problem::slows(
                format!("`ulimit -u` allows {count} processes and threads of this user"),
                "raise it, or lower --threads",
            ));
        }
    }

    pub(super) fn line(&self) -> String {
        let size = |bytes: Option<u64>| bytes.map_or_else(|| "no limit".into(), sized);
        let count = |count: Option<u64>| count.map_or_else(|| "no limit".into(), |count| count.to_string());
        format!(
            "limits     addresses {}; a file {}; open files {}; processes {}",
            size(self.address_space),
            size(self.file_size),
            count(self.open_files),
            count(self.processes)
        )
    }
}

/// A short text of the system's own, where there is one.
fn system_text(path: &str) -> Option<String> {
    use std::io::Read;
    let mut text = String::new();
    std::fs::File::open(path).ok()?.take(1 << 20).read_to_string(&mut text).ok()?;
    Some(text)
}

/// The value of the first line `NAME: VALUE`.
fn field<'a>(text: &'a str, name: &str) -> Option<&'a str> {
    text.lines().find_map(|line| {
        let (key, value) = line.split_once(':')?;
        (key.trim() == name).then(|| value.trim())
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_slows_a_job_is_a_problem_and_nothing_else() {
        let judged = |judge: &dyn Fn(&mut Vec<Problem>)| {
            let mut problems = Vec::new();
            judge(&mut problems);
            problems.into_iter().map(|problem| problem.what).collect::<Vec<_>>().join("; ")
        };
        let processor =
            |cores, threads, instructions| Processor { model: None, cores, threads, instructions };
        let of = |found: Processor| judged(&|problems| found.judge(problems));
        assert_eq!(of(processor(Some(8), 8, "AVX2")), "");
        assert_eq!(of(processor(None, 1, "AVX2")), "");
        assert_eq!(of(processor(Some(8), 2, "AVX2")), "a job uses 2 threads of 8");
        assert!(of(processor(Some(1), 1, simd::SCALAR)).contains("AVX2"));

        let memory = |available, group_limit| {
            let found = Memory { total: None, available, group_limit };
            judged(&|problems| found.judge(problems))
        };
        assert_eq!(memory(None, None), "");
        assert_eq!(memory(Some(8 << 30), None), "");
        assert_eq!(memory(Some(8 << 30), Some(1 << 30)), "1.0 GiB of memory can be used");
        assert_eq!(memory(Some(512 << 20), Some(8 << 30)), "512.0 MiB of memory can be used");

        let limits = |limits: Limits| judged(&|problems| limits.judge(problems));
        assert_eq!(limits(Limits::default()), "");
        let few = Limits {
            address_space: Some(1 << 30),
            file_size: Some(1 << 20),
            open_files: Some(64),
            processes: Some(10),
        };
        let found = limits(few);
        for flag in ["-v", "-f", "-n", "-u"] {
            assert!(found.contains(&format!("`ulimit {flag}`")), "{flag}: {found}");
        }
    }

    #[test]
    fn facts_of_the_system_are_read_by_name() {
        let text = "processor\t: 0\nmodel name\t: A B: C\nMemTotal:  24 kB\n";
        assert_eq!(field(text, "model name"), Some("A B: C"));
        assert_eq!(field(text, "MemTotal"), Some("24 kB"));
        assert_eq!(field(text, "Mem"), None);
    }
}
