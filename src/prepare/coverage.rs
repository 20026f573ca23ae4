//! Coverage: which skin vertices lie inside proxies. Apart from ownership: a vertex has one owner, and may lie in many.

use super::{Proxy, Skin};

/// A point on an inflated face counts as inside; rounding of a plane's distance, as a share of the skin's size.
const ROUNDING: f64 = 1e-12;

/// Share of skin vertices inside at least one proxy inflated by its margin. 1 is promised by construction; this looks
/// at the hulls themselves. Vertices are tried against their owner first, so that it costs vertices times faces.
pub fn share(skin: &Skin, proxies: &[Proxy]) -> f64 {
    if skin.vertices.is_empty() {
        return 1.0;
    }
    let size = skin.vertices.iter().map(|v| v.abs().max_element()).fold(0.0, f64::max);
    let inside = |proxy: &Proxy, v: u32| {
        let x = skin.vertices[v as usize];
        proxy.faces.iter().all(|(n, d)| n.dot(x) - d <= proxy.margin + ROUNDING * size)
    };
    let mut covered = vec![false; skin.vertices.len()];
    for proxy in proxies {
        proxy.vertices.iter().for_each(|&v| covered[v as usize] = inside(proxy, v));
    }
    for (v, covered) in covered.iter_mut().enumerate().filter(|(_, covered)| !**covered) {
        *covered = proxies.iter().any(|proxy| inside(proxy, v as u32));
    }
    covered.iter().filter(|&&c| c).count() as f64 / covered.len() as f64
}
