//! Passes over neighbour lists, written once for every kernel pair and every form of lanes.

use super::{
    Kernel,
    lanes::{Eight, Lanes},
    pair::{Pair, Poly6Spiky, Wendland},
};

/// The work of one chunk.
pub(super) trait Pass {
    /// What it finds.
    type Out;
    /// Does the work. To be inlined always, so that the form's instructions reach every line of it.
    fn run<L: Lanes, P: Pair>(self) -> Self::Out;
}

/// Does `pass` with the kernel pair, in the fastest form that the processor runs.
pub(super) fn run<W: Pass>(kernel: Kernel, pass: W) -> W::Out {
    match kernel {
        Kernel::Poly6Spiky => run_with::<W, Poly6Spiky>(pass),
        Kernel::Wendland => run_with::<W, Wendland>(pass),
    }
}

fn run_with<W: Pass, P: Pair>(pass: W) -> W::Out {
    #[cfg(test)]
    if tests::REFERENCE_ONLY.get() {
        return pass.run::<Eight, P>();
    }
    #[cfg(target_arch = "x86_64")]
    if super::lanes_avx2::available() {
        return super::lanes_avx2::run::<W, P>(pass);
    }
    pass.run::<Eight, P>()
}

#[cfg(test)]
mod tests {
    use crate::{
        frame::FrameIndex,
        math::Vec3,
        par,
        sim::{Simulation, Unwatched, World, liquid::LiquidParams},
        solid::{Shape, Solid},
    };
    use std::cell::Cell;

    thread_local! {
        /// Whether passes on this thread take the reference form.
        pub(super) static REFERENCE_ONLY: Cell<bool> = const { Cell::new(false) };
    }

    /// The bits of every position, velocity and gain of energy after two blocks fell on each other and a ball.
    fn bits(params: &LiquidParams, reference_only: bool) -> Vec<u32> {
        // On a pool of one thread, which then is the thread of every pass.
        par::with_threads(1, || {
            REFERENCE_ONLY.set(reference_only);
            let tank = Shape::Tank { min: [0.0; 3], max: [0.6, 0.4, 1.0] };
            let ball = Shape::Sphere { center: [0.2, 0.2, 0.0], radius: 0.15 };
            let solids = vec![Solid::fixed(tank), Solid::fixed(ball)];
            let world = World { gravity: Vec3::new(0.0, 0.0, -9.81), solids };
            let mut simulation = Simulation::new(world, Some(params.clone())).expect("there are particles");
            let mut bits = Vec::new();
            for _ in 0..3 {
                let record = simulation.advance(1.0 / 24.0, &mut Unwatched).expect("it stays finite");
                bits.extend([record.iterations, record.list_rebuilds]);
                bits.push((record.confinement_energy as f32).to_bits());
            }
            let frame = simulation.frame(FrameIndex(0));
            for name in ["position", "velocity"] {
                let values = frame.streams[0].vec3(name).expect("liquids have it");
                bits.extend(values.iter().flat_map(|v| v.iter().map(|c| c.to_bits())));
            }
            bits
        })
    }

    #[test]
    fn whole_runs_have_the_same_bits_in_both_forms() {
        for (solver, kernel) in [("accelerated", "wendland"), ("jacobi", "poly6_spiky")] {
            let text = format!(
                "spacing = 0.04\nsolver = '{solver}'\nkernel = '{kernel}'\n\
                 artificial_pressure = {{}}\nvorticity = {{}}\nviscosity = {{ strength = 0.05 }}\n\
                 [[source]]\nshape = {{ box = {{ min = [0, 0, 0.2], max = [0.3, 0.3, 0.5] }} }}\n\
                 [[source]]\nvelocity = [-3, 0.5, -2]\n\
                 shape = {{ box = {{ min = [0.32, 0.05, 0.3], max = [0.56, 0.35, 0.6] }} }}"
            );
            let params: LiquidParams = toml::from_str(&text).expect("it is a liquid");
            assert!(bits(&params, true) == bits(&params, false), "{solver}, {kernel}");
        }
    }
}
