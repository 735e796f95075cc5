//! A unit sphere as triangles, to be mapped to an ellipsoid. Its triangles are given, so that an ellipsoid that is flat in one or two
//! directions is drawn as well.

use nalgebra::Vector3;
use std::f64::consts::{PI, TAU};

/// Circles of latitude between the poles.
const CIRCLES: usize = 7;

/// Vertices of a circle.
const MERIDIANS: usize = 14;

/// The vertices: north pole, circle after circle, south pole.
pub(super) fn vertices() -> impl Iterator<Item = Vector3<f64>> {
    let circles = (1..=CIRCLES).flat_map(|circle| {
        let latitude = PI * circle as f64 / (CIRCLES + 1) as f64;
        (0..MERIDIANS).map(move |meridian| {
            let longitude = TAU * meridian as f64 / MERIDIANS as f64;
            Vector3::new(
                latitude.sin() * longitude.cos(),
                latitude.sin() * longitude.sin(),
                latitude.cos(),
            )
        })
    });
    std::iter::once(Vector3::z())
        .chain(circles)
        .chain(std::iter::once(-Vector3::z()))
}

/// First, second and third vertex of each triangle, counter-clockwise seen from outside.
pub(super) fn triangles() -> (Vec<usize>, Vec<usize>, Vec<usize>) {
    let vertex = |circle: usize, meridian: usize| match circle {
        0 => 0,
        c if c > CIRCLES => CIRCLES * MERIDIANS + 1,
        c => 1 + (c - 1) * MERIDIANS + meridian % MERIDIANS,
    };
    let (mut i, mut j, mut k) = (Vec::new(), Vec::new(), Vec::new());
    let mut triangle = |a, b, c| {
        i.push(a);
        j.push(b);
        k.push(c);
    };
    for circle in 0..=CIRCLES {
        for m in 0..MERIDIANS {
            let (here, below) = (vertex(circle, m), vertex(circle + 1, m));
            let (right, below_right) = (vertex(circle, m + 1), vertex(circle + 1, m + 1));
            if circle < CIRCLES {
                triangle(here, below, below_right);
            }
            if circle > 0 {
                triangle(here, below_right, right);
            }
        }
    }
    (i, j, k)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Volume by the divergence theorem: a wrong orientation, a hole or a doubled triangle changes it.
    #[test]
    fn triangles_enclose_the_ball() {
        let points: Vec<_> = vertices().collect();
        let (i, j, k) = triangles();
        let sixfold: f64 = (0..i.len())
            .map(|t| points[i[t]].dot(&points[j[t]].cross(&points[k[t]])))
            .sum();
        let volume = sixfold / 6.0;
        let ball = 4.0 / 3.0 * PI;
        // An inscribed polyhedron with facets of some 24 degrees misses a tenth.
        assert!(volume < ball && volume > 0.88 * ball, "{volume} of {ball}");
        // Euler's formula for a closed surface: V - E + F = 2 with E = 3F/2.
        assert_eq!(points.len(), 2 + i.len() / 2);
    }
}
