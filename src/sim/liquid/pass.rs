//! Passes over neighbour lists, generic over kernel pairs and lane types.

use super::{
    Kernel,
    pair::{Pair, Poly6Spiky, Wendland},
};
use crate::simd::{self, Lanes, Pass};
use std::marker::PhantomData;

/// A pass over one chunk of particles.
pub(super) trait NeighbourPass {
    /// Result of the pass.
    type Out;
    /// Runs the pass. Must be inlined, so that every line of it uses the instructions of the lane type.
    fn run<L: Lanes, P: Pair>(self) -> Self::Out;
}

/// Runs `pass` with a kernel pair, on the fastest lane type of the processor.
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

    /// Bits of all positions, velocities and confinement energies after two blocks fell on each other and on a ball.
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
        for name in ["position", "velocity", "microrotation"] {
            let values = frame.streams[0].vec3(name).expect("this liquid has it");
            bits.extend(values.iter().flat_map(|v| v.iter().map(|c| c.to_bits())));
        }
        bits
    }

    #[test]
    fn whole_runs_have_the_same_bits_on_both_lane_types() {
        let solvers = [("accelerated", "wendland"), ("jacobi", "poly6_spiky")];
        for (solver, kernel) in solvers.into_iter().take(if crate::is_soak() { 2 } else { 1 }) {
            let text = format!(
                "spacing = 0.04\nsolver = '{solver}'\nkernel = '{kernel}'\n\
                 artificial_pressure = {{}}\nviscosity = {{ dynamic = 2 }}\nvorticity = {{}}\nmicropolar = {{}}\n\
                 xsph = {{ strength = 0.05 }}\nsurface_tension = {{ coefficient = 30 }}\n\
                 [[source]]\nshape = {{ box = {{ min = [0, 0, 0.2], max = [0.3, 0.3, 0.5] }} }}\n\
                 [[source]]\nvelocity = [-3, 0.5, -2]\n\
                 shape = {{ box = {{ min = [0.32, 0.05, 0.3], max = [0.56, 0.35, 0.6] }} }}"
            );
            let params: LiquidParams = crate::from_toml(&text);
            let [scalar, fastest] = in_both_forms(|| bits(&params));
            assert!(scalar == fastest, "{solver}, {kernel}");
        }
    }
}
