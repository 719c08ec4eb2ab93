//! Examples at the end of each verb's help.

pub(super) const SHOT: &str = "Examples:\n  \
    meniscus shot dam-break --quality draft                         seconds, into dam-break-draft/\n  \
    meniscus shot my-shot.toml --frames 1-48 --max-memory 8GiB      half of a shot, if it fits\n  \
    meniscus shot my-shot.toml --set liquid.spacing=0.01 -o fine    another spacing, in a folder of its own\n  \
    meniscus shot fine --from 24 --set liquid.viscosity.dynamic=5   a branch that shares frames 1 to 23";

pub(super) const SIMULATE: &str = "Examples:\n  \
    meniscus simulate my-shot.toml && meniscus mesh my-shot\n  \
    meniscus mesh my-shot --follow & meniscus simulate my-shot.toml    meshes while it simulates";

pub(super) const PLAN: &str = "Examples:\n  \
    meniscus plan my-shot.toml --quality preview\n  \
    meniscus plan my-shot.toml --max-memory 8GiB --json || echo too large";

pub(super) const MESH: &str = "Examples:\n  \
    meniscus mesh my-shot --voxel 0.4 --force                     every frame again, on a finer grid\n  \
    meniscus mesh 'frame_####.bgeo' --spacing \"2 cm\" -o meshes    particles of another solver\n  \
    meniscus mesh 'wedge_*' --format ply,obj                      several shots";

pub(super) const VOLUME: &str = "Examples:\n  \
    meniscus volume my-smoke --frames 1-48\n  \
    meniscus volume 'frame_####.vtk' --spacing 0.02 -o volumes";

pub(super) const EXPORT: &str = "Examples:\n  \
    meniscus export my-cloth --format pc2,obj";

pub(super) const WHITEWATER: &str = "Examples:\n  \
    meniscus whitewater my-shot --force    again, without simulating the liquid";

pub(super) const USD: &str = "Examples:\n  \
    meniscus usd my-shot                                    metres and Z up, as Blender and Solaris take it\n  \
    meniscus usd my-shot --up y --scale 100 --names maya    centimetres and Y up";

pub(super) const PREVIEW: &str = "Examples:\n  \
    meniscus preview my-shot                              preview/contact.png and preview/loop.webp\n  \
    meniscus preview my-shot --frames 24,48 --report      and these frames, and preview/report.html\n  \
    meniscus preview my-shot --show speed                 particles by speed";

pub(super) const VERIFY: &str = "Examples:\n  \
    meniscus verify my-shot && echo complete";

pub(super) const TRADEOFF: &str = "Examples:\n  \
    meniscus tradeoff dam-break                               sensible settings, one second\n  \
    meniscus tradeoff shot.toml --vary liquid.cfl=0.2,0.4,0.8 --vary liquid.density_dev=0.3%,1%,3%\n  \
    meniscus tradeoff shot.toml --time 2h --write tonight.toml    the most exact that is done in two hours\n  \
    meniscus tradeoff shot.toml --dev 0.5%                    the fastest that is exact to 0.5 %\n  \
    meniscus tradeoff smoke-ring --quality draft              smoke: error, method, steps, cores, voxel\n  \
    meniscus tradeoff sheet-corners                           sheets: integrator, steps, tolerance, cells\n  \
    meniscus tradeoff my-shot --of surface --vary surface.voxel=0.25,0.5,1 --vary 'surface.smoothing=none,{}'\n  \
    meniscus tradeoff 'frame_####.bgeo' --of surface --spacing 0.05 --frames 40,80";

pub(super) const WEDGE: &str = "Examples:\n  \
    meniscus wedge dam-break --quality draft --set liquid.vorticity.strength=0,0.1,0.3\n  \
    meniscus wedge shot.toml --set liquid.spacing=0.02,0.03 --set liquid.viscosity.dynamic=0.1,10 --at 24,48,96\n  \
    meniscus wedge shot.toml --set fps=24,25 --prepare && meniscus farm slurm shot-wedges";

pub(super) const FARM: &str = "Examples:\n  \
    meniscus farm slurm shots/dam --preset dam-break --quality preview --threads 8\n  \
    meniscus farm openjd shots/dam --chunk 24 --max-memory 8GiB\n  \
    meniscus farm flamenco wedges/dam";

pub(super) const COMPLETIONS: &str = "Examples:\n  \
    meniscus completions bash > ~/.local/share/bash-completion/completions/meniscus\n  \
    meniscus completions zsh > ~/.zfunc/_meniscus        with ~/.zfunc in $fpath\n  \
    meniscus completions fish > ~/.config/fish/completions/meniscus.fish\n  \
    meniscus completions powershell | Out-String | Invoke-Expression";

pub(super) const MAN: &str = "Examples:\n  \
    meniscus man | man -l -\n  \
    meniscus man -o ~/.local/share/man/man1 && man meniscus-mesh";

#[cfg(test)]
mod tests {
    use super::*;
    use crate::cli::args;

    /// The words of a command, which may be in quotes, up to what a shell would read as its end, or the comment after two spaces.
    fn words(command: &str) -> Vec<String> {
        let mut words = vec![String::new()];
        let (mut quote, mut spaces) = (None, 0);
        for character in command.chars() {
            spaces = if character == ' ' { spaces + 1 } else { 0 };
            match (quote, character) {
                (None, '&' | '|' | '>') => break,
                (None, ' ') if spaces == 1 => words.push(String::new()),
                (None, ' ') => break,
                (None, '\'' | '"') => quote = Some(character),
                (Some(open), _) if open == character => quote = None,
                _ => words.last_mut().expect("there is a first word").push(character),
            }
        }
        words.retain(|word| !word.is_empty());
        words
    }

    #[test]
    fn every_example_is_a_command() {
        let all = [
            SHOT,
            SIMULATE,
            PLAN,
            MESH,
            VOLUME,
            EXPORT,
            WHITEWATER,
            USD,
            PREVIEW,
            VERIFY,
            TRADEOFF,
            WEDGE,
            FARM,
            COMPLETIONS,
            MAN,
        ];
        let mut count = 0;
        for line in all.iter().flat_map(|text| text.lines()) {
            for command in line.split("&& ").flat_map(|part| part.split("& ")) {
                let words = words(command.trim());
                if words.first().is_some_and(|word| word == "meniscus") {
                    count += 1;
                    let parsed = args::command().try_get_matches_from(&words);
                    assert!(parsed.is_ok(), "{words:?}: {}", parsed.unwrap_err());
                }
            }
        }
        assert!(count >= 30, "{count} examples");
    }
}
