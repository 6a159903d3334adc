//! Colours of layer values: blue outside, orange inside, which all kinds of colour vision tell
//! apart, and both pale enough for the dark surface between them.

/// Between two values of a picture.
const STEP: u8 = 3;

/// Red, green, blue.
pub(super) type Rgb = [u8; 3];

/// Surface voxels, words, axes.
pub(super) const INK: Rgb = [30, 34, 42];
/// Words that matter less.
pub(super) const FAINT: Rgb = [110, 116, 128];
/// Points of the shell, on any of the colours below.
pub(super) const PAPER: Rgb = [255, 255, 255];

/// Behind what is lit.
pub(super) const BACKDROP: Rgb = [243, 246, 249];

const FAR_OUTSIDE: Rgb = [247, 249, 252];
const OUTSIDE: [Rgb; 2] = [[74, 144, 200], [219, 232, 245]];
const DEEP_INSIDE: Rgb = [251, 226, 186];
const INSIDE: [Rgb; 2] = [[224, 122, 32], [247, 205, 146]];

/// The colour of a layer value; beyond the band it is flat.
pub(super) fn of_layer(value: i8, n_layers: u32) -> Rgb {
    let depth = u32::from(value.unsigned_abs());
    if depth == 0 {
        return INK;
    }
    let ([near, far], beyond) =
        if value < 0 { (OUTSIDE, FAR_OUTSIDE) } else { (INSIDE, DEEP_INSIDE) };
    if depth > n_layers {
        return beyond;
    }
    let share = f64::from(depth - 1) / f64::from(n_layers.saturating_sub(1).max(1));
    core::array::from_fn(|channel| {
        (f64::from(near[channel]) + share * (f64::from(far[channel]) - f64::from(near[channel])))
            .round() as u8
    })
}

/// Light of an sRGB value, 0 to 1 (IEC 61966-2-1).
pub(super) fn to_linear(value: u8) -> f32 {
    let share = f32::from(value) / 255.0;
    if share <= 0.04045 { share / 12.92 } else { ((share + 0.055) / 1.055).powf(2.4) }
}

/// The other way round, in steps that no eye sees and that take a fifth off a file; more light than
/// white is white.
pub(super) fn to_srgb(light: f32) -> u8 {
    let light = light.clamp(0.0, 1.0);
    let share =
        if light <= 0.003_130_8 { 12.92 * light } else { 1.055 * light.powf(1.0 / 2.4) - 0.055 };
    let step = f32::from(STEP);
    ((share * 255.0 / step).round() * step).min(255.0) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn layers_brighten_away_from_the_surface_on_both_sides() {
        let brightness = |value: i8| of_layer(value, 8).map(u32::from).iter().sum::<u32>();
        for side in [-1, 1] {
            assert!(
                (0..9).all(|layer| brightness(side * layer) < brightness(side * (layer + 1))),
                "{side}"
            );
        }
        assert_eq!(of_layer(1, 1), INSIDE[0]);
        assert!(of_layer(-9, 8)[2] > of_layer(-9, 8)[0] && of_layer(9, 8)[2] < of_layer(9, 8)[0]);
    }
}
