//! The `meniscus` binary: runs the command line and returns its exit code.

#[global_allocator]
static ALLOCATOR: meniscus::cli::Allocator = meniscus::cli::Allocator;

fn main() -> std::process::ExitCode {
    meniscus::cli::main()
}
