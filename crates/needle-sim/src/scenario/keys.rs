//! The keys of a scenario, written once: each section lists its keys with range and meaning, and whoever walks over them reads
//! a file, prints the scenario, or prints what may be written.

use std::path::PathBuf;

/// Numbers that a key accepts.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(crate) enum Allowed {
    /// Any number in [low, high].
    From(f64, f64),
    /// Any number in (low, high].
    Above(f64, f64),
}

/// Sizes beyond this are no needle's: a metre, a thousand seconds, a million of anything.
const LARGEST: f64 = 1e6;

impl Allowed {
    /// From 0 on.
    pub(crate) const NOT_NEGATIVE: Self = Self::From(0.0, LARGEST);
    /// Above 0.
    pub(crate) const POSITIVE: Self = Self::Above(0.0, LARGEST);
    /// Of either sign.
    pub(crate) const ANY: Self = Self::From(-LARGEST, LARGEST);
    /// A share or a probability.
    pub(crate) const FRACTION: Self = Self::From(0.0, 1.0);

    /// Whether `value` is one of them; NaN never is.
    pub(crate) fn holds(self, value: f64) -> bool {
        match self {
            Self::From(low, high) => (low..=high).contains(&value),
            Self::Above(low, high) => low < value && value <= high,
        }
    }
}

impl std::fmt::Display for Allowed {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::From(low, high) => write!(f, "from {low} to {high}"),
            Self::Above(low, high) => write!(f, "above {low}, at most {high}"),
        }
    }
}

/// A choice among variants, each with keys of its own.
pub(crate) struct Choice<'a> {
    /// Key that holds the variant's name.
    pub(crate) key: &'static str,
    /// What is chosen.
    pub(crate) about: &'static str,
    /// Names, in the order of the variants.
    pub(crate) names: &'static [&'static str],
    /// The present variant, which holds where the key is absent.
    pub(crate) chosen: usize,
    /// Whether the key must be there.
    pub(crate) required: bool,
    /// Takes on a variant and walks over its keys.
    pub(crate) variant: &'a mut dyn FnMut(usize, &mut dyn Keys),
}

/// Whoever walks over the keys. Values come in as defaults; a reader leaves what the file says. A number that is NaN by default
/// has no default: its key must be there.
pub(crate) trait Keys {
    /// A number.
    fn number(&mut self, key: &'static str, value: &mut f64, allowed: Allowed, about: &'static str);
    /// A number that may be absent.
    fn optional(
        &mut self,
        key: &'static str,
        value: &mut Option<f64>,
        allowed: Allowed,
        about: &'static str,
    );
    /// A list of as many numbers as `values` has.
    fn numbers(
        &mut self,
        key: &'static str,
        values: &mut [f64],
        allowed: Allowed,
        about: &'static str,
    );
    /// A whole number.
    fn count(
        &mut self,
        key: &'static str,
        value: &mut u64,
        allowed: (u64, u64),
        about: &'static str,
    );
    /// True or false.
    fn flag(&mut self, key: &'static str, value: &mut bool, about: &'static str);
    /// A file, relative to the scenario's; empty by default, which is no file: the key must be there.
    fn file(&mut self, key: &'static str, value: &mut PathBuf, about: &'static str);
    /// A table of keys.
    fn table(
        &mut self,
        key: &'static str,
        about: &'static str,
        section: &mut dyn FnMut(&mut dyn Keys),
    );
    /// A list of tables, of which `rows` are there; `row` walks over the keys of one, which may be new.
    fn rows(
        &mut self,
        key: &'static str,
        about: &'static str,
        rows: usize,
        row: &mut dyn FnMut(usize, &mut dyn Keys),
    );
    /// A choice among variants.
    fn choice(&mut self, choice: Choice<'_>);
}

/// [`Keys::count`] for counts of the controllers.
pub(crate) fn size(
    keys: &mut dyn Keys,
    key: &'static str,
    value: &mut usize,
    allowed: (u64, u64),
    about: &'static str,
) {
    let mut count = *value as u64;
    keys.count(key, &mut count, allowed, about);
    *value = usize::try_from(count).unwrap_or(*value);
}

/// A choice without keys of its own.
pub(crate) fn one_of<T: Copy + PartialEq>(
    keys: &mut dyn Keys,
    key: &'static str,
    value: &mut T,
    (names, variants): (&'static [&'static str], &[T]),
    about: &'static str,
) {
    let chosen = variants.iter().position(|v| v == value).unwrap_or(0);
    keys.choice(Choice {
        key,
        about,
        names,
        chosen,
        required: false,
        variant: &mut |index, _| {
            if let Some(variant) = variants.get(index) {
                *value = *variant;
            }
        },
    });
}
