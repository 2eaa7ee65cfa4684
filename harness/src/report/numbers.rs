//! Numbers as people read them.

/// Three significant digits, without exponent.
pub fn significant(x: f64) -> String {
    let digits = if x > 0.0 { x.log10().floor() as i32 + 1 } else { 1 };
    let decimals = (3 - digits).clamp(0, 6) as usize;
    format!("{x:.decimals$}")
}

/// Nanoseconds as milliseconds.
pub fn milliseconds(ns: u64) -> String {
    significant(ns as f64 * 1e-6)
}

/// One digit and an exponent; an exact zero is 0.
pub fn scientific(x: f64) -> String {
    if x == 0.0 { "0".to_owned() } else { format!("{x:.1e}") }
}

/// Whole numbers with separators between thousands.
pub fn grouped(n: u64) -> String {
    let digits = n.to_string();
    let mut text = String::new();
    for (i, digit) in digits.chars().enumerate() {
        if i > 0 && (digits.len() - i).is_multiple_of(3) {
            text.push(',');
        }
        text.push(digit);
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn three_digits() {
        assert_eq!(
            [0.0, 0.01234, 1.234, 56.78, 1234.5].map(significant),
            ["0.00", "0.0123", "1.23", "56.8", "1234"]
        );
    }

    #[test]
    fn thousands() {
        assert_eq!([0, 999, 1000, 1234567].map(grouped), ["0", "999", "1,000", "1,234,567"]);
    }
}
