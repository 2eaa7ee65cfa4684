//! Builds: the few numbers in which two bodies differ.

/// Which body. All have the same parts and bones, hence correspondences by construction.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Build {
    /// The one that carries the motion: midway between the other two, 1.73 m.
    Template,
    /// Male proportions, broad, 1.82 m.
    Male,
    /// Female proportions, slender, 1.66 m.
    Female,
}

/// Turns the tables of the anatomy (centimetres of a body 180 cm tall, a male and a female number) into metres.
#[derive(Clone, Copy, Debug)]
pub(super) struct Proportions {
    scale: f64,
    /// 0 male, 1 female.
    share: f64,
}

impl Proportions {
    pub(super) fn new(build: Build) -> Self {
        let (stature, share) = match build {
            Build::Template => (1.73, 0.5),
            Build::Male => (1.82, 0.0),
            Build::Female => (1.66, 1.0),
        };
        Self { scale: stature / 180.0, share }
    }

    /// A length that both sexes share.
    pub(super) fn one(&self, centimetres: f64) -> f64 {
        self.scale * centimetres
    }

    /// A length with its male and female number.
    pub(super) fn of(&self, [male, female]: [f64; 2]) -> f64 {
        self.scale * (male + self.share * (female - male))
    }

    /// A point, or three lengths, with male and female numbers.
    pub(super) fn point(&self, [male, female]: [[f64; 3]; 2]) -> [f64; 3] {
        std::array::from_fn(|i| self.of([male[i], female[i]]))
    }
}
