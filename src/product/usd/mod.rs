//! USD stages of shots, made of the files of other products: `docs/decisions/039-usd.md`.

mod folder;
mod frames;
mod layers;
mod product;
mod root;
mod sources;

pub(super) use folder::UsdStage;
