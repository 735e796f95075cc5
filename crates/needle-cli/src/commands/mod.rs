//! The commands, one file each.

pub(crate) mod check;
pub(crate) mod compare;
pub(crate) mod reference;
pub(crate) mod run;
pub(crate) mod schema;
