//! Materials of the aircraft's parts, and how they reflect light.

/// Surface material.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash)]
pub enum Material {
    /// White paint of the fuselage.
    Fuselage,
    /// Grey belly.
    Belly,
    /// Coloured paint of the fin.
    Tail,
    /// Light grey of wings and horizontal tail.
    Wing,
    /// Flaps: as the wing, but dirtier.
    Flap,
    /// Cowling of the engines.
    Cowling,
    /// Dark inside of intakes and nozzles.
    Intake,
    /// Cockpit and cabin windows.
    Window,
    /// Metal of landing gear legs.
    Leg,
    /// Rubber.
    Tyre,
}

impl Material {
    /// Diffuse reflectance for red, green and blue light, linear, 0 to 1.
    pub fn reflectance(self) -> [f32; 3] {
        match self {
            Self::Fuselage => [0.80, 0.80, 0.80],
            Self::Belly => [0.50, 0.51, 0.53],
            Self::Tail => [0.05, 0.10, 0.36],
            Self::Wing => [0.46, 0.47, 0.49],
            Self::Flap => [0.36, 0.37, 0.38],
            Self::Cowling => [0.62, 0.63, 0.65],
            Self::Intake => [0.025, 0.025, 0.028],
            Self::Window => [0.020, 0.022, 0.026],
            Self::Leg => [0.42, 0.42, 0.43],
            Self::Tyre => [0.028, 0.028, 0.028],
        }
    }
}
