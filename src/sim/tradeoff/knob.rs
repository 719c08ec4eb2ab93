//! Knobs: settings of a scene that a tradeoff can read, write, and make finer.

use crate::sim::scene::Scene;
use std::rc::Rc;

/// Writes a value into a scene.
type Edit = Rc<dyn Fn(&mut Scene)>;

/// A change of a scene, as `--set` takes it: `liquid.cfl=0.2`.
#[derive(Clone)]
pub(crate) struct Change {
    /// The dotted key and the value.
    pub text: String,
    /// Writes the value; `None` if it is the user's text, which has to be read and checked first.
    pub apply: Option<Edit>,
}

/// Settings that vary together, and the alternatives to try.
pub(crate) type Axis = Vec<Vec<Change>>;

impl Change {
    /// A change that `apply` makes.
    pub(crate) fn new(text: impl Into<String>, apply: impl Fn(&mut Scene) + 'static) -> Self {
        Self { text: text.into(), apply: Some(Rc::new(apply)) }
    }
}

/// A setting that is made of numbers.
pub(crate) trait Setting {
    /// Numbers of the setting; `None` if it is absent.
    fn get(&self) -> Option<Vec<f64>>;
    /// Writes the values, and returns them as in a preset.
    fn set(&mut self, value: &[f64]) -> String;
}

impl Setting for f32 {
    fn get(&self) -> Option<Vec<f64>> {
        Some(vec![(*self).into()])
    }

    fn set(&mut self, value: &[f64]) -> String {
        // The digits that single precision has.
        *self = format!("{:.5e}", value[0]).parse().expect("a number was written");
        self.to_string()
    }
}

impl Setting for u32 {
    fn get(&self) -> Option<Vec<f64>> {
        Some(vec![(*self).into()])
    }

    fn set(&mut self, value: &[f64]) -> String {
        *self = value[0].round().max(1.0) as u32;
        self.to_string()
    }
}

impl<T: Setting + Default> Setting for Option<T> {
    fn get(&self) -> Option<Vec<f64>> {
        self.as_ref()?.get()
    }

    fn set(&mut self, value: &[f64]) -> String {
        self.get_or_insert_default().set(value)
    }
}

/// The cells of a grid.
impl Setting for [u32; 2] {
    fn get(&self) -> Option<Vec<f64>> {
        Some(self.map(f64::from).to_vec())
    }

    fn set(&mut self, value: &[f64]) -> String {
        // At least one cell, but none where there are none.
        *self = [0, 1].map(|axis| value[axis].round().max(value[axis].ceil().min(1.0)) as u32);
        format!("{self:?}")
    }
}

/// A setting of a scene, and how it becomes finer.
#[derive(Clone, Copy)]
pub(crate) struct Knob {
    /// Dotted key; `#` stands for `index`.
    key: &'static str,
    /// Index in a list of the scene.
    index: usize,
    field: fn(&mut Scene, usize) -> Option<&mut dyn Setting>,
    finer: Finer,
    /// Key of the limit that is relaxed so that it does not stop the finer setting.
    opens: &'static str,
    /// Whether the reference refines it whatever is varied.
    always: bool,
}

#[derive(Clone, Copy)]
enum Finer {
    /// The knob has no finer direction.
    No,
    /// The finest value of all rows times a factor, and at least this.
    Times(f64, f64),
    /// The largest value of all rows, once and for all.
    Largest,
    /// What this makes of the scene, and returns by its name in presets; `None` if the scene is as fine.
    Choice(fn(&mut Scene) -> Option<&'static str>),
    /// A limit: at least this where a refined knob may reach it.
    Limit(fn(&Scene) -> f64),
}

impl Knob {
    /// A setting of numbers.
    pub(crate) const fn new(
        key: &'static str,
        field: fn(&mut Scene, usize) -> Option<&mut dyn Setting>,
    ) -> Self {
        Self { key, index: 0, field, finer: Finer::No, opens: "", always: false }
    }

    /// A choice whose finest option `finest` makes and returns; it returns `None` if the scene's choice is as fine.
    pub(crate) const fn choice(key: &'static str, finest: fn(&mut Scene) -> Option<&'static str>) -> Self {
        Self { finer: Finer::Choice(finest), ..Self::new(key, |_, _| None) }
    }

    /// Becomes finer by this factor.
    pub(crate) const fn times(self, factor: f64) -> Self {
        self.times_down_to(factor, 0.0)
    }

    /// Becomes finer by this factor, but not smaller than `least`.
    pub(crate) const fn times_down_to(self, factor: f64, least: f64) -> Self {
        Self { finer: Finer::Times(factor, least), ..self }
    }

    /// Is finest at its largest value of all rows.
    pub(crate) const fn largest(self) -> Self {
        Self { finer: Finer::Largest, ..self }
    }

    /// Is a limit, of at least this in a reference that refines what it limits.
    pub(crate) const fn limit(self, least: fn(&Scene) -> f64) -> Self {
        Self { finer: Finer::Limit(least), ..self }
    }

    /// Opens a limit when it is refined.
    pub(crate) const fn opens(self, limit: &'static str) -> Self {
        Self { opens: limit, ..self }
    }

    /// Is refined whatever is varied.
    pub(crate) const fn always(self) -> Self {
        Self { always: true, ..self }
    }

    /// The knob of another place in the list.
    pub(crate) const fn at(self, index: usize) -> Self {
        Self { index, ..self }
    }

    /// Dotted key of the preset.
    pub(crate) fn key(&self) -> String {
        self.key.replace('#', &self.index.to_string())
    }

    /// Numbers of the setting in a scene; `None` if the scene has no such setting.
    fn get(&self, scene: &Scene) -> Option<Vec<f64>> {
        (self.field)(&mut scene.clone(), self.index)?.get()
    }

    /// Writes its numbers, and returns the change; `None` if the scene has no such setting.
    fn set(&self, scene: &mut Scene, value: &[f64]) -> Option<String> {
        Some(format!("{}={}", self.key(), (self.field)(scene, self.index)?.set(value)))
    }

    /// The change of a scene to what `to` makes of each of the knob's numbers; `None` if the scene has no such setting.
    pub(crate) fn change(&self, scene: &Scene, to: impl Fn(f64) -> f64) -> Option<Change> {
        let (knob, value) = (*self, self.get(scene)?.into_iter().map(to).collect::<Vec<f64>>());
        let text = knob.set(&mut scene.clone(), &value)?;
        Some(Change::new(text, move |scene| _ = knob.set(scene, &value)))
    }

    /// Each number as fine as in any of the scenes.
    fn finest(&self, scenes: &[&Scene], finest: fn(f64, f64) -> f64) -> Option<Vec<f64>> {
        let join = |a: Vec<f64>, b: Vec<f64>| a.into_iter().zip(b).map(|(a, b)| finest(a, b)).collect();
        scenes.iter().filter_map(|scene| self.get(scene)).reduce(join)
    }
}

/// An alternative per factor, in which each of these knobs is that many times the scene's value, within its bounds.
pub(crate) fn multiples<const N: usize>(
    scene: &Scene,
    knobs: &[(Knob, [f64; 2])],
    factors: [f64; N],
) -> Axis {
    let change = |(knob, [least, most]): &(Knob, [f64; 2]), factor: f64| {
        knob.change(scene, |value| (value * factor).clamp(*least, *most))
    };
    factors.map(|factor| knobs.iter().filter_map(|knob| change(knob, factor)).collect()).to_vec()
}

/// The knobs that a reference refines if these keys, or parts of these tables, are varied.
pub(crate) fn refined(knobs: &[Knob], keys: &[String]) -> Vec<Knob> {
    let is_varied = |knob: &Knob| {
        let rest =
            |key: &String| key.strip_prefix(&knob.key()).map(|rest| rest.is_empty() || rest.starts_with('.'));
        keys.iter().any(|key| rest(key) == Some(true))
    };
    let is_refined =
        |knob: &&Knob| !matches!(knob.finer, Finer::No | Finer::Limit(_)) && (knob.always || is_varied(knob));
    knobs.iter().filter(is_refined).copied().collect()
}

/// Makes a scene finer than all of `scenes` by the knobs `refined`, and opens the limits among `all` that these may run
/// into. Returns the changes.
pub(crate) fn refine(scene: &mut Scene, all: &[Knob], refined: &[Knob], scenes: &[&Scene]) -> Vec<String> {
    let is_opened = |limit: &&Knob| {
        let is_refined = refined.iter().any(|knob| knob.key == limit.key && knob.get(scene).is_some());
        matches!(limit.finer, Finer::Limit(_)) && refined.iter().any(|k| k.opens == limit.key) && !is_refined
    };
    let opened: Vec<Knob> = all.iter().filter(is_opened).copied().collect();
    let mut changes = Vec::new();
    for knob in refined.iter().chain(&opened) {
        let times = |value: Vec<f64>, factor: f64, least: f64| -> Vec<f64> {
            value.into_iter().map(|value| (value * factor).max(least)).collect()
        };
        let value = match knob.finer {
            Finer::No => None,
            Finer::Times(factor, least) => {
                let finest = if factor < 1.0 { f64::min } else { f64::max };
                knob.finest(scenes, finest).map(|value| times(value, factor, least))
            }
            Finer::Largest => knob.finest(scenes, f64::max),
            Finer::Limit(least) => knob.finest(scenes, f64::max).map(|value| times(value, 1.0, least(scene))),
            Finer::Choice(choose) => {
                changes.extend(choose(scene).map(|word| format!("{}={word}", knob.key())));
                None
            }
        };
        changes.extend(value.and_then(|value| knob.set(scene, &value)));
    }
    changes
}
