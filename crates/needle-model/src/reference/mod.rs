//! Paths to follow, the part of them that a controller sees, and progress along them.

pub(crate) mod paper_reference;
pub(crate) mod path_progress;
pub(crate) mod reference_path;
pub(crate) mod reference_window;
