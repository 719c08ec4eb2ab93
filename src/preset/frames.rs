//! Lists of frames, as artists write them: `1-96`, `1-240x2`, `1,5,9-12`.

use crate::frame::FrameIndex;
use schemars::{JsonSchema, Schema, SchemaGenerator, json_schema};
use serde::{Deserialize, Serialize};
use std::{borrow::Cow, fmt, str::FromStr};

/// Some frames in a row, every `step`-th of them.
///
/// Invariant: `first ≤ last`, `step ≥ 1`, `last` is itself one of the frames, and a single frame has step 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Range {
    first: u32,
    last: u32,
    step: u32,
}

/// The frames to compute, in ascending order: one or more ranges.
///
/// Invariant: there is at least one frame, and each range begins after the one before it has ended.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Frames {
    ranges: Vec<Range>,
}

/// Why a text is not a list of frames.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum FramesError {
    /// Nothing between commas, or nothing at all.
    #[error("a frame is missing; write frames as `1-96`, `1-240x2` or `1,5,9-12`")]
    Empty,
    /// A colon or dots where a dash belongs.
    #[error("`{found}` is not how a range is written; use `{instead}`")]
    NotADash {
        /// The range as written.
        found: String,
        /// What to write.
        instead: String,
    },
    /// Something else than a whole number from 0 to 4294967295.
    #[error("`{found}` is not a frame number (a whole number from 0 to 4294967295)")]
    NotANumber {
        /// The text in the number's place.
        found: String,
    },
    /// A range that runs backwards.
    #[error("`{first}-{last}` runs backwards; write `{last}-{first}`")]
    Descending {
        /// First frame.
        first: u32,
        /// Last frame.
        last: u32,
    },
    /// A step of zero.
    #[error("a step of 0 never reaches the next frame; use `x1` or more")]
    ZeroStep,
    /// A frame that the ranges before it have already passed.
    #[error("frame {frame} comes after frame {after}; list each frame once, in ascending order")]
    NotAscending {
        /// The frame that steps back.
        frame: u32,
        /// Last frame of the range before.
        after: u32,
    },
}

impl Frames {
    /// The frames `first` to `last`; `None` if `first` is above `last`.
    pub fn from_first_to_last(first: FrameIndex, last: FrameIndex) -> Option<Self> {
        (first <= last).then(|| Self { ranges: vec![Range { first: first.0, last: last.0, step: 1 }] })
    }

    /// The first frame: the initial state.
    pub fn first(&self) -> FrameIndex {
        FrameIndex(self.ranges[0].first)
    }

    /// The last frame.
    pub fn last(&self) -> FrameIndex {
        FrameIndex(self.ranges[self.ranges.len() - 1].last)
    }

    /// The number of frames, at least 1.
    pub fn count(&self) -> u64 {
        self.ranges.iter().map(|range| u64::from((range.last - range.first) / range.step) + 1).sum()
    }

    /// First frame, last frame and step of each range, in ascending order.
    pub fn ranges(&self) -> impl Iterator<Item = (u32, u32, u32)> + '_ {
        self.ranges.iter().map(|&Range { first, last, step }| (first, last, step))
    }

    /// Whether `frame` is one of them.
    pub fn contains(&self, frame: FrameIndex) -> bool {
        self.ranges.iter().any(|range| {
            (range.first..=range.last).contains(&frame.0)
                && (frame.0 - range.first).is_multiple_of(range.step)
        })
    }

    /// Every frame, in ascending order.
    pub fn iter(&self) -> impl Iterator<Item = FrameIndex> + '_ {
        self.ranges
            .iter()
            .flat_map(|range| (range.first..=range.last).step_by(range.step as usize))
            .map(FrameIndex)
    }
}

impl FromStr for Frames {
    type Err = FramesError;

    fn from_str(text: &str) -> Result<Self, FramesError> {
        let mut ranges: Vec<Range> = Vec::new();
        for part in text.split(',') {
            let range = range(part.trim())?;
            if let Some(before) = ranges.last()
                && range.first <= before.last
            {
                return Err(FramesError::NotAscending { frame: range.first, after: before.last });
            }
            ranges.push(range);
        }
        Ok(Self { ranges })
    }
}

/// One part between commas: `5`, `1-96`, `1-240x2`.
fn range(part: &str) -> Result<Range, FramesError> {
    if part.is_empty() {
        return Err(FramesError::Empty);
    }
    for separator in [":", "..=", "..", "…", "–"] {
        if let Some((first, last)) = part.split_once(separator) {
            let whole = |text: &str| !text.is_empty() && text.bytes().all(|b| b.is_ascii_digit());
            let (first, last) = (first.trim(), last.trim());
            let instead =
                if whole(first) && whole(last) { format!("{first}-{last}") } else { "1-96".to_owned() };
            return Err(FramesError::NotADash { found: part.to_owned(), instead });
        }
    }
    let (span, step) = match part.split_once('x') {
        Some((span, step)) => (span, number(step)?),
        None => (part, 1),
    };
    let (first, last) = match span.split_once('-') {
        Some((first, last)) => (number(first)?, number(last)?),
        None => (number(span)?, number(span)?),
    };
    if step == 0 {
        return Err(FramesError::ZeroStep);
    }
    if first > last {
        return Err(FramesError::Descending { first, last });
    }
    let last = last - (last - first) % step;
    Ok(Range { first, last, step: if first == last { 1 } else { step } })
}

fn number(text: &str) -> Result<u32, FramesError> {
    let text = text.trim();
    let digits = text.bytes().all(|b| b.is_ascii_digit());
    text.parse().ok().filter(|_| digits).ok_or_else(|| FramesError::NotANumber { found: text.to_owned() })
}

/// The canonical form: `last` is a frame of the range, and a step of one is not written.
impl fmt::Display for Frames {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (index, &Range { first, last, step }) in self.ranges.iter().enumerate() {
            if index > 0 {
                f.write_str(",")?;
            }
            match (first == last, step) {
                (true, _) => write!(f, "{first}")?,
                (false, 1) => write!(f, "{first}-{last}")?,
                (false, _) => write!(f, "{first}-{last}x{step}")?,
            }
        }
        Ok(())
    }
}

impl TryFrom<String> for Frames {
    type Error = FramesError;

    fn try_from(text: String) -> Result<Self, FramesError> {
        text.parse()
    }
}

impl From<Frames> for String {
    fn from(frames: Frames) -> Self {
        frames.to_string()
    }
}

impl JsonSchema for Frames {
    fn schema_name() -> Cow<'static, str> {
        "Frames".into()
    }

    fn inline_schema() -> bool {
        true
    }

    fn json_schema(_: &mut SchemaGenerator) -> Schema {
        json_schema!({ "type": "string", "format": "frames" })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn listed(text: &str) -> Vec<u32> {
        text.parse::<Frames>().unwrap().iter().map(|frame| frame.0).collect()
    }

    #[test]
    fn lists_are_read_as_written() {
        assert_eq!(listed("1-4"), [1, 2, 3, 4]);
        assert_eq!(listed("1-8x3"), [1, 4, 7]);
        assert_eq!(listed("1, 5, 9-12"), [1, 5, 9, 10, 11, 12]);
        assert_eq!(listed("0"), [0]);
        assert_eq!(listed("4294967290-4294967295x4"), [4_294_967_290, 4_294_967_294]);
        let frames: Frames = "1,5,9-12x2".parse().unwrap();
        assert_eq!((frames.first(), frames.last(), frames.count()), (FrameIndex(1), FrameIndex(11), 4));
        assert!(frames.contains(FrameIndex(11)) && !frames.contains(FrameIndex(12)));
        assert_eq!(frames.ranges().collect::<Vec<_>>(), [(1, 1, 1), (5, 5, 1), (9, 11, 2)]);
    }

    #[test]
    fn mistakes_are_named_with_what_to_write() {
        let message = |text: &str| text.parse::<Frames>().unwrap_err().to_string();
        assert!(message(":").contains("use `1-96`"));
        assert!(message("1:96").contains("use `1-96`"));
        assert!(message("3..8").contains("use `3-8`"));
        assert!(message("9-3").contains("write `3-9`"));
        assert!(message("1-9x0").contains("step of 0"));
        assert!(message("5,1").contains("ascending"));
        assert!(message("1-5,5").contains("ascending"));
        for text in ["", "1,", "1--2", "-1", "+1", "1-", "x", "1x", "1.5", "4294967296", "１"] {
            assert!(text.parse::<Frames>().is_err(), "{text}");
        }
    }

    proptest! {
        #[test]
        fn the_canonical_form_reads_as_the_same_frames(parts in prop::collection::vec((0_u32..50, 0_u32..40, 1_u32..7), 1..5)) {
            let mut text = Vec::new();
            let mut at = 0;
            for (gap, length, step) in parts {
                let first = at + gap;
                text.push(format!("{first}-{}x{step}", first + length));
                at = first + length + 1;
            }
            let frames: Frames = text.join(",").parse().unwrap();
            let again: Frames = frames.to_string().parse().unwrap();
            prop_assert_eq!(&frames, &again);
            let all: Vec<u32> = frames.iter().map(|frame| frame.0).collect();
            prop_assert!(all.is_sorted_by(|a, b| a < b));
            prop_assert_eq!(all.len() as u64, frames.count());
            let found: Vec<u32> = (0..at + 3).filter(|&i| frames.contains(FrameIndex(i))).collect();
            prop_assert_eq!(all, found);
        }

        #[test]
        fn no_text_panics(text in "[0-9x,:. -]{0,12}") {
            let _ = text.parse::<Frames>();
        }
    }
}
