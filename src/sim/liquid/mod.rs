//! Position based fluid ([pbf]).

mod params;

pub use params::{
    ArtificialPressure, Constraint, LiquidParams, LiquidSource, SourceShape, VorticityConfinement, Xsph,
};
