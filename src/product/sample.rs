//! Samples: products of a few frames, made to measure what they take.

use super::{
    interface::Product,
    registry::ALL,
    request::{ProductInput, ProductRequest, ProductSettings},
};
use crate::{
    cache,
    frame::StreamKind,
    job::{
        Control, RunError, ShotFolder, Silent,
        batch::{BatchRequest, BatchSummary, Source},
        usage::Meter,
    },
    preset::Frames,
    sim::{
        forecast::{ElementCount, ProductSample, ProductSampler},
        scene::Scene,
    },
};

/// The products that a scene requests.
pub(crate) struct RequestedProducts;

impl RequestedProducts {
    /// The products that a scene requests and that accept streams of one of these kinds.
    fn of(settings: &ProductSettings, kinds: &[StreamKind]) -> Vec<&'static dyn Product> {
        let accepts = |product: &dyn Product| kinds.iter().any(|&kind| product.accepts(kind));
        ALL.into_iter().filter(|&product| product.is_requested(settings) && accepts(product)).collect()
    }

    /// A bound of the peak memory of making products of so many elements, by their names [bytes].
    pub(crate) fn max_memory(scene: &Scene, counts: &[ElementCount]) -> Vec<(&'static str, f64)> {
        let settings = &ProductSettings::of(scene);
        let kinds: Vec<StreamKind> = counts.iter().map(|count| count.kind).collect();
        let products = Self::of(settings, &kinds).into_iter();
        let memory = |product: &dyn Product| {
            let accepted = counts.iter().filter(|count| product.accepts(count.kind));
            accepted
                .map(|count| product.max_memory(settings, count.kind, count.max() as usize))
                .fold(0.0, f64::max)
        };
        products.map(|product| (product.name(), memory(product))).collect()
    }
}

impl ProductSampler for RequestedProducts {
    fn sample(
        &self,
        scene: &Scene,
        shot: &ShotFolder,
        frames: &Frames,
        control: Control,
    ) -> Result<Vec<ProductSample>, RunError> {
        let settings = &ProductSettings::of(scene);
        let (last, _) = cache::read_frame(&cache::frame_path(&shot.cache(), frames.last()))?;
        let kinds: Vec<StreamKind> = last.streams.iter().map(|stream| stream.kind).collect();
        let batch = BatchRequest {
            selection: Some(frames.clone()),
            force: true,
            max_memory: None,
            concurrent: false,
            follow: None,
            fps: f64::from(scene.fps),
        };
        let request = ProductRequest {
            input: ProductInput::Frames(Source::Cache(shot)),
            out: shot,
            settings,
            scene: Some(scene),
            retime: None,
            batch: &batch,
        };
        let control = Control { reporter: &Silent, ..control };
        let sample = |product: &dyn Product| {
            let meter = Meter::new();
            let (made, failed) = match product.make(&request, control) {
                Err(why @ (RunError::SomeFailed { .. } | RunError::Request(_))) => {
                    (BatchSummary::default(), Some(why.to_string()))
                }
                made => (made?, None),
            };
            let (work, seconds) = (meter.work(), meter.wall());
            let accepted = last.streams.iter().filter(|stream| product.accepts(stream.kind));
            let memory = accepted
                .map(|stream| product.stream_memory(settings, stream, made.triangles))
                .fold(0.0, f64::max);
            Ok(ProductSample {
                name: product.name(),
                work,
                seconds,
                bytes: made.bytes as f64,
                memory,
                failed,
            })
        };
        Self::of(settings, &kinds).into_iter().map(sample).collect()
    }
}
