//! Simulates the draft of a built-in preset in this process, without a cache:
//! `cargo run --release --example simulate_preset -- dam-break`.

use meniscus::{
    frame::FrameIndex,
    scene::{self, Overrides, Quality, Scene},
    sim::{Simulation, Unwatched},
};
use std::{env, error::Error};

fn main() -> Result<(), Box<dyn Error>> {
    let name = env::args().nth(1).unwrap_or_else(|| "dam-break".into());
    let overrides = Overrides { quality: Some(Quality::Draft), set: Vec::new() };
    let scene = Scene::from_preset(&scene::load(&name)?, &overrides)?;
    let mut simulation = Simulation::new(scene.surroundings(), scene.systems())?;
    for index in scene.frames.iter().skip(1).take(5).map(|FrameIndex(index)| index) {
        simulation.advance(1.0 / f64::from(scene.fps), &mut Unwatched)?;
        for stream in &simulation.frame(FrameIndex(index)).streams {
            println!("frame {index}  {}  {} entries", stream.name, stream.len());
        }
    }
    Ok(())
}
