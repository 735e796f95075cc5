//! Claims about the baselines and the estimator, alone and in closed loop. Marked as tests so that their helpers may
//! unwrap like the tests that call them.

#[cfg(test)]
mod adversity;
#[cfg(test)]
mod baselines;
#[cfg(test)]
mod consistency;
#[cfg(test)]
#[path = "../deviates/mod.rs"]
mod deviates;
#[cfg(test)]
mod estimation;
#[cfg(test)]
mod harness;
#[cfg(test)]
mod memory;
#[cfg(test)]
mod offset_free;
#[cfg(test)]
mod survival;
#[cfg(test)]
mod watching;
