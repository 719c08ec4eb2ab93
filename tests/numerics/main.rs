//! The numerics, judged by closed forms, conservation, experiments and extremes.

mod liquid;
