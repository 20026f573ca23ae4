//! Contact patches in f64. A contact patch is a column of space in which two bodies may touch, with one contact normal.
//! This file computes boxes of chunks (groups of at most 64 skin vertices) along a patch's axes, and the depth and
//! normal of a vertex that lies in several patches. Reference implementation of the shaders `cull/chunks` and
//! `contact/candidates`.

use glam::{DMat3, DQuat, DVec3};

/// Least and greatest corner, along `patch_axes`, of a box that holds a chunk's skin after its nodes were displaced. At
/// rest the chunk lies in the box with the given centre and with `half_extent` along `axes`, in the coordinates of a
/// rigid frame, which lies at `place` with the given rotation. A skin vertex is x = c + R sum w_i (r_i + d_i), with the
/// frame's place c and rotation R, embedding weights w_i whose sum is 1, and rest positions r_i and displacements d_i
/// of nodes. The d_i have a middle and, along each axis, a half range. In the frame's coordinates the vertex is displaced
/// by the middle, with a deviation along each axis of at most `weight_bound` times the half range; `weight_bound` is the
/// greatest sum of |w_i| of a vertex.
pub fn chunk_box(
    (centre, axes, half_extent): (DVec3, DMat3, DVec3),
    (displacements, weight_bound): (&[DVec3], f64),
    (place, rotation): (DVec3, DQuat),
    patch_axes: [DVec3; 3],
) -> (DVec3, DVec3) {
    let (mut middle, mut spread) = (DVec3::ZERO, DVec3::ZERO);
    if !displacements.is_empty() {
        let low = displacements.iter().fold(DVec3::INFINITY, |low, d| low.min(*d));
        let high = displacements.iter().fold(DVec3::NEG_INFINITY, |high, d| high.max(*d));
        (middle, spread) = ((low + high) * 0.5, (high - low) * 0.5 * weight_bound);
    }
    let at = place + rotation * (centre + middle);
    let arms = (0..3).map(|k| axes.col(k) * half_extent[k]).chain((0..3).map(|k| DVec3::AXES[k] * spread[k]));
    let reach = arms.map(|arm| along(patch_axes, rotation * arm).abs()).sum::<DVec3>();
    let at = along(patch_axes, at);
    (at - reach, at + reach)
}

/// Coordinates of a point along a contact patch's axes.
pub fn along(axes: [DVec3; 3], x: DVec3) -> DVec3 {
    DVec3::from_array(axes.map(|axis| axis.dot(x)))
}

/// Depth and normal of a vertex that lies in several contact patches. Each element of `seen` is one patch: its share
/// (the weight of the patch at the vertex), the depth along its normal, and its normal. The patch with the greatest
/// strength, share / depth^2, has full weight. The weight of another patch rises smoothly from zero at half of the
/// greatest strength to full weight at equal strength. The returned normal is `None` where the normals cancel.
pub fn blend(seen: &[(f64, f64, DVec3)]) -> Option<(f64, Option<DVec3>)> {
    let strength = |(share, depth, _): &(f64, f64, DVec3)| share / (depth * depth);
    let strongest = seen.iter().map(strength).fold(0.0, f64::max);
    if strongest <= 0.0 {
        return None;
    }
    let (mut all, mut depth, mut normal) = (0.0, 0.0, DVec3::ZERO);
    for one in seen {
        let share = strength(one) / strongest;
        let t = (2.0 * share - 1.0).clamp(0.0, 1.0);
        let weight = share * t * t * (3.0 - 2.0 * t);
        all += weight;
        depth += weight * one.1;
        normal += weight * one.2;
    }
    Some((depth / all, (normal.length() > 1e-3 * all).then(|| normal.normalize())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_regions_count_alike_and_those_less_than_half_as_strong_do_not() {
        let two = |share: f64| blend(&[(0.5, 0.01, DVec3::X), (share, 0.01, DVec3::Y)]).unwrap();
        assert!((two(0.5).1.unwrap() - (DVec3::X + DVec3::Y).normalize()).length() < 1e-12);
        assert_eq!(two(0.2), (0.01, Some(DVec3::X)));
        // A patch with twice the depth has a quarter of the strength.
        assert_eq!(blend(&[(0.5, 0.01, DVec3::X), (0.5, 0.02, DVec3::Y)]).unwrap().0, 0.01);
        assert_eq!(blend(&[(0.5, 0.01, DVec3::X), (0.5, 0.01, -DVec3::X)]), Some((0.01, None)));
        assert_eq!(blend(&[]), None);
    }

    #[test]
    fn a_box_moves_with_its_nodes_and_grows_with_their_spread() {
        let rest = (DVec3::X, DMat3::IDENTITY, DVec3::new(0.1, 0.2, 0.3));
        let still = (DVec3::ZERO, DQuat::IDENTITY);
        let (low, high) = chunk_box(rest, (&[DVec3::Y, 1.2 * DVec3::Y], 1.5), still, DVec3::AXES);
        assert!((low - DVec3::new(0.9, 0.75, -0.3)).length() < 1e-12, "least corner {low}");
        assert!((high - DVec3::new(1.1, 1.45, 0.3)).length() < 1e-12, "greatest corner {high}");
        let turn = DQuat::from_rotation_z(std::f64::consts::FRAC_PI_2);
        let (low, high) = chunk_box(rest, (&[], 1.0), (DVec3::Z, turn), DVec3::AXES);
        assert!((low - DVec3::new(-0.2, 0.9, 0.7)).length() < 1e-12, "least corner {low}");
        assert!((high - DVec3::new(0.2, 1.1, 1.3)).length() < 1e-12, "greatest corner {high}");
    }
}
