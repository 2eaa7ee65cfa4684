//! What the names of joints say; motion files have no other way to say it.

/// Side of a body.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Side {
    /// Its left.
    Left,
    /// Its right.
    Right,
}

/// The side that a joint's name tells: `LeftArm`, `lShin`, `L_Foot`, `hand.R`.
pub fn side(name: &str) -> Option<Side> {
    let lower = name.to_ascii_lowercase();
    for (word, side) in [("left", Side::Left), ("right", Side::Right)] {
        if lower.contains(word) {
            return Some(side);
        }
    }
    let parted = |c: char| c == '_' || c == '.' || c == '-' || c == ':' || c == ' ';
    let word = name.split(parted).map(str::to_ascii_lowercase).find(|word| word == "l" || word == "r");
    let mut first = name.chars();
    let letter = word.or_else(|| match (first.next(), first.next()) {
        (Some(letter @ ('l' | 'L' | 'r' | 'R')), Some(next)) if next.is_ascii_uppercase() => {
            Some(letter.to_ascii_lowercase().to_string())
        }
        _ => None,
    })?;
    Some(if letter == "l" { Side::Left } else { Side::Right })
}

/// Whether the name is that of a shoulder joint (`arm`) or a hip joint: where the upper arm or the thigh begins.
pub fn begins_limb(name: &str, arm: bool) -> bool {
    let lower = name.to_ascii_lowercase().replace(['_', '.', '-', ' '], "");
    let has = |words: &[&str]| words.iter().any(|word| lower.contains(word));
    match arm {
        true => has(&["arm", "shldr"]) && !has(&["fore", "lower", "armature"]),
        false => has(&["upleg", "upperleg", "thigh"]) || (has(&["hip"]) && !has(&["hips", "joint"])),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn sides_and_limbs() {
        for name in ["LeftUpLeg", "lShin", "L_Foot", "hand.L", "LHipJoint", "mixamorig:LeftArm"] {
            assert_eq!(side(name), Some(Side::Left), "{name}");
        }
        for name in ["RightArm", "rShldr", "RFoot", "Bip01 R Thigh"] {
            assert_eq!(side(name), Some(Side::Right), "{name}");
        }
        for name in ["LowerBack", "Hips", "Spine1", "root", "Neck", "roll"] {
            assert_eq!(side(name), None, "{name}");
        }
        assert!(["LeftArm", "rShldr", "upper_arm.R"].iter().all(|name| begins_limb(name, true)));
        assert!(!["LeftForeArm", "LeftShoulder", "lower_arm.R"].iter().any(|name| begins_limb(name, true)));
        assert!(["LeftUpLeg", "thigh.L", "lHip"].iter().all(|name| begins_limb(name, false)));
        assert!(!["LeftLeg", "LHipJoint", "Hips"].iter().any(|name| begins_limb(name, false)));
    }
}
