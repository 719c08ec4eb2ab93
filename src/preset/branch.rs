//! Branches: shots that go on from a frame of another shot with other settings.

use crate::{cache::FrameKeys, frame::FrameIndex};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Where a shot branched from another one. `simulate --from` writes it.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(deny_unknown_fields)]
pub struct Branch {
    /// The first frame of the branch, after the shot's first.
    pub frame: u32,
    /// The key of the simulation that frames before it are of: 16 hexadecimal digits.
    pub before: String,
}

impl Branch {
    /// The key of the simulation that frames before it are of, if it is one.
    pub(crate) fn key(&self) -> Option<u64> {
        let is_hex = self.before.len() == 16 && self.before.bytes().all(|digit| digit.is_ascii_hexdigit());
        u64::from_str_radix(&self.before, 16).ok().filter(|_| is_hex)
    }
}

/// The keys of the frames of a simulation with the key `own` and these branches; `None` if one has no key.
pub(crate) fn frame_keys(own: u64, branches: &[Branch]) -> Option<FrameKeys> {
    let inherited = branches.iter().map(|branch| Some((FrameIndex(branch.frame), branch.key()?)));
    Some(FrameKeys::new(own, inherited.collect::<Option<_>>()?))
}
