//! Lists what the cached frames of a shot folder hold: `cargo run --example read_cache -- dam-break`.

use meniscus::cache;
use std::{env, error::Error, path::Path};

fn main() -> Result<(), Box<dyn Error>> {
    let folder = env::args().nth(1).ok_or("usage: read_cache SHOT_FOLDER")?;
    for (index, path) in cache::list(&Path::new(&folder).join("cache"))? {
        let (frame, _) = cache::read_frame(&path)?;
        for stream in &frame.streams {
            let channels: Vec<&str> = stream.channels().iter().map(|channel| channel.name.as_str()).collect();
            println!(
                "frame {index} at {:.3} s  {}  {} × {}",
                frame.time,
                stream.name,
                stream.len(),
                channels.join(", ")
            );
        }
    }
    Ok(())
}
