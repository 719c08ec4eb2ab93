//! Tests of what all products share.

use super::{ALL, ParticleLook, PreviewParams, ProductInput, ProductRequest, ProductSettings};
use crate::{
    cache,
    control::CancelToken,
    export::{MeshFormat, SheetFormat, usd::StageParams, vdb::VolumeGrid},
    frame::{Frame, FrameIndex, Stream, StreamKind},
    job::{
        Control, ShotFolder, Silent,
        batch::{BatchRequest, Source},
    },
    math::Vec3,
    sim::{scene::Output, whitewater::WhitewaterParams},
};

/// A ball of particles 0.1 m apart.
fn ball(name: &str, kind: StreamKind) -> Stream {
    let nodes = (0..1000).map(|i| Vec3::new((i % 10) as f32, (i / 10 % 10) as f32, (i / 100) as f32) * 0.1);
    let positions: Vec<Vec3> = nodes.filter(|x| (x - Vec3::repeat(0.45)).norm() < 0.3).collect();
    let mut stream = Stream::new(name, kind, positions.len()).with("position", positions);
    stream.scalars = vec![("spacing".into(), 0.1)];
    stream
}

/// All products of a cache with one frame of these streams: files by sub-folder, or why a product was not made.
fn make_all(streams: Vec<Stream>) -> Vec<Result<Vec<String>, String>> {
    let dir = tempfile::tempdir().unwrap();
    let folder = ShotFolder::new(dir.path());
    ShotFolder::create(&folder.cache()).unwrap();
    cache::write_frame(&folder.cache(), &Frame { index: FrameIndex(1), time: 0.0, streams }, 7).unwrap();
    let output = Output {
        mesh: vec![MeshFormat::Ply],
        volume: VolumeGrid::ALL.to_vec(),
        sheet: SheetFormat::ALL.to_vec(),
        thickness: None,
    };
    let (whitewater, usd) = (Some(WhitewaterParams::default()), Some(StageParams::default()));
    let (size, particles) = ([32, 18], ParticleLook::Surface);
    let preview = Some(PreviewParams { size, frames: true, particles, shows_kept: false });
    let settings = ProductSettings {
        output,
        whitewater,
        points: true,
        colliders: true,
        usd,
        preview,
        ..ProductSettings::default()
    };
    let batch = BatchRequest {
        selection: None,
        force: false,
        max_memory: None,
        concurrent: false,
        follow: None,
        fps: 24.0,
    };
    let input = ProductInput::Frames(Source::Cache(&folder));
    let request =
        ProductRequest { input, out: &folder, settings: &settings, scene: None, retime: None, batch: &batch };
    let cancel = CancelToken::new();
    let control = Control::new(&Silent, &cancel);
    let make = |product: &&dyn super::interface::Product| {
        assert!(product.is_requested(&settings), "{}", product.name());
        product.make(&request, control).map_err(|why| why.to_string())?;
        let entries = std::fs::read_dir(folder.subfolder(product.name())).unwrap();
        let names = entries.map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned());
        Ok(names.filter(|name| name.contains("_0001.")).collect())
    };
    ALL.iter().map(make).collect()
}

#[test]
fn nothing_is_made_of_streams_of_unknown_kind() {
    assert!(ALL.iter().all(|product| !product.accepts(StreamKind::Unknown)));
    // It has all that particles have.
    let alone = make_all(vec![ball("foam", StreamKind::Unknown)]);
    assert!(alone.iter().all(Result::is_err), "{alone:?}");
    let both = make_all(vec![ball("liquid", StreamKind::Particles), ball("foam", StreamKind::Unknown)]);
    assert_eq!(both[0].as_deref(), Ok(&["liquid_0001.ply".to_owned()][..]));
    assert_eq!(both[1].as_deref(), Ok(&["liquid_0001.vdb".to_owned()][..]));
    assert!(both[2..7].iter().all(Result::is_err), "{both:?}");
    // Of the files of the others.
    assert_eq!(both[7].as_deref(), Ok(&["mesh-liquid_0001.usdc".to_owned()][..]));
    assert_eq!(both[8].as_deref(), Ok(&["frame_0001.png".to_owned()][..]));
}
