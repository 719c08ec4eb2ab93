//! The registry: every product of the tool.

use super::{
    colliders::ColliderMeshes, interface::Product, point_cache::PointCache, points::TracerPoints,
    preview::Preview, sheet_mesh::SheetMesh, surface::SurfaceMesh, usd::UsdStage, volume::VolumeFile,
    whitewater::WhitewaterPoints,
};

/// Every product, in the order in which they are made.
pub(crate) static ALL: [&dyn Product; 9] = [
    &SurfaceMesh,
    &VolumeFile,
    &SheetMesh,
    &PointCache,
    &TracerPoints,
    &WhitewaterPoints,
    &ColliderMeshes,
    &UsdStage,
    &Preview,
];
