//! Passes over neighbour lists, written once for every kernel pair and every form of lanes.

use super::{
    Kernel,
    pair::{Pair, Poly6Spiky, Wendland},
};
use crate::simd::{self, Lanes, Pass};
use std::marker::PhantomData;

/// The work of one chunk.
pub(super) trait NeighbourPass {
    /// What the pass returns.
    type Out;
    /// Runs the pass. To be inlined always, so that the form's instructions reach every line of it.
    fn run<L: Lanes, P: Pair>(self) -> Self::Out;
}

/// Runs `pass` with the kernel pair, in the fastest form that the processor supports.
pub(super) fn run<W: NeighbourPass>(kernel: Kernel, pass: W) -> W::Out {
    match kernel {
        Kernel::Poly6Spiky => simd::dispatch(WithKernel::<W, Poly6Spiky>(pass, PhantomData)),
        Kernel::Wendland => simd::dispatch(WithKernel::<W, Wendland>(pass, PhantomData)),
    }
}

/// A pass with its kernel pair.
struct WithKernel<W, P>(W, PhantomData<P>);

impl<W: NeighbourPass, P: Pair> Pass for WithKernel<W, P> {
    type Out = W::Out;

    #[inline(always)]
    fn run<L: Lanes>(self) -> W::Out {
        self.0.run::<L, P>()
    }
}

#[cfg(test)]
mod tests {
    use crate::{
        frame::FrameIndex,
        math::Vec3,
        sim::{Simulation, Unwatched, World, liquid::LiquidParams},
        simd::tests::in_both_forms,
        solid::{Shape, Solid},
    };

    /// The bits of every position, velocity and gain of energy after two blocks fell on each other and a ball.
    fn bits(params: &LiquidParams) -> Vec<u32> {
        let tank = Shape::Tank { min: [0.0; 3], max: [0.6, 0.4, 1.0] };
        let ball = Shape::Sphere { center: [0.2, 0.2, 0.0], radius: 0.15 };
        let solids = vec![Solid::fixed(tank), Solid::fixed(ball)];
        let world = World { gravity: Vec3::new(0.0, 0.0, -9.81), solids };
        let mut simulation = Simulation::new(world, Some(params.clone())).expect("there are particles");
        let mut bits = Vec::new();
        for _ in 0..3 {
            let record =
                simulation.advance(1.0 / 24.0, &mut Unwatched).expect("it stays finite").liquid.unwrap();
            bits.extend([record.iterations, record.list_rebuilds]);
            bits.push((record.confinement_energy as f32).to_bits());
        }
        let frame = simulation.frame(FrameIndex(0));
        for name in ["position", "velocity"] {
            let values = frame.streams[0].vec3(name).expect("liquids have it");
            bits.extend(values.iter().flat_map(|v| v.iter().map(|c| c.to_bits())));
        }
        bits
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
            let [scalar, fastest] = in_both_forms(|| bits(&params));
            assert!(scalar == fastest, "{solver}, {kernel}");
        }
    }
}
