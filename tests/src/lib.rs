//! Holds no code: the claims are the test files in `tests/`.
