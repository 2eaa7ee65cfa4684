//! Arithmetic on 3-vectors `[f64; 3]`: only `+ - * /` and `sqrt`, which round the same on every machine.

/// A point or direction, in the order x, y, z.
pub type Vector = [f64; 3];

/// a + b.
pub fn add(a: Vector, b: Vector) -> Vector {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

/// a - b.
pub fn sub(a: Vector, b: Vector) -> Vector {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

/// s a.
pub fn scale(s: f64, a: Vector) -> Vector {
    [s * a[0], s * a[1], s * a[2]]
}

/// a + s b.
pub fn add_scaled(a: Vector, s: f64, b: Vector) -> Vector {
    [a[0] + s * b[0], a[1] + s * b[1], a[2] + s * b[2]]
}

/// (1 - s) a + s b.
pub fn lerp(a: Vector, b: Vector, s: f64) -> Vector {
    add_scaled(a, s, sub(b, a))
}

/// Inner product.
pub fn dot(a: Vector, b: Vector) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// Cross product, right-handed.
pub fn cross(a: Vector, b: Vector) -> Vector {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Euclidean length.
pub fn norm(a: Vector) -> f64 {
    dot(a, a).sqrt()
}

/// a / |a|, or the zero vector where |a| is zero.
pub fn normalize(a: Vector) -> Vector {
    let length = norm(a);
    if length > 0.0 { scale(1.0 / length, a) } else { [0.0; 3] }
}

/// Normal of the triangle (a, b, c), counter-clockwise; its length is twice the area.
pub fn area_normal(a: Vector, b: Vector, c: Vector) -> Vector {
    cross(sub(b, a), sub(c, a))
}
