//! Text files of paths and poses.

pub(crate) mod path_csv;
pub(crate) mod path_file;
pub(crate) mod planner_poses;
