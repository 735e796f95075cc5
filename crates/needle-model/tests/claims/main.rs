//! Claims about the needle model, one a test, grouped by concern. Marked as tests so that
//! their helpers may unwrap like the tests that call them.

#[cfg(test)]
mod arcs;
#[cfg(test)]
mod chart;
#[cfg(test)]
mod controllability;
#[cfg(test)]
mod curves;
#[cfg(test)]
mod effects;
#[cfg(test)]
mod finite_difference;
#[cfg(test)]
mod kinematics;
#[cfg(test)]
mod linearisation;
#[cfg(test)]
mod paths;
#[cfg(test)]
mod positions;
#[cfg(test)]
mod printed;
#[cfg(test)]
mod robustness;
