//! Matrices: dense kernels, fixed sizes, scaling, definiteness, eigenvalues, wide and exact arithmetic. Knows no Riccati equation.

pub(crate) mod definiteness;
pub(crate) mod dense;
pub(crate) mod double_double;
pub(crate) mod exact;
pub(crate) mod fixed_block;
pub(crate) mod fixed_size;
pub(crate) mod hessenberg_qr;
pub(crate) mod scaling;
