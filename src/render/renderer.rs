//! Either of the twins, and which.

use super::cpu::Cpu;
use super::error::{RenderError, Result};
use super::frame::{Drawing, Picture};
use super::gpu::{AdapterPreference, Gpu};
use super::scene::Scene;

/// What is to draw.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Choice {
    /// A real GPU where there is one and it works, else the CPU.
    #[default]
    Auto,
    Cpu,
    /// Any adapter, also one in software; an error where there is none.
    Gpu,
}

/// A renderer that is ready to draw.
pub struct Renderer {
    choice: Choice,
    gpu: Option<Gpu>,
    cpu: Cpu,
}

impl Renderer {
    pub fn open(choice: Choice) -> Result<Renderer> {
        let gpu = match choice {
            Choice::Cpu => None,
            Choice::Auto => Gpu::open(AdapterPreference::Hardware).unwrap_or_else(|error| {
                tracing::warn!(%error, "the GPU cannot be used; the CPU draws");
                None
            }),
            Choice::Gpu => {
                let none = || RenderError::Gpu("there is no Vulkan driver with an adapter".into());
                Some(Gpu::open(AdapterPreference::Any)?.ok_or_else(none)?)
            }
        };
        Ok(Renderer { choice, gpu, cpu: Cpu::default() })
    }

    /// Who draws: the adapter's name, or `cpu`.
    pub fn name(&self) -> &str {
        self.gpu.as_ref().map_or("cpu", Gpu::name)
    }

    /// Draws a scene. A GPU that fails is not asked again where the choice was
    /// left to us.
    pub fn draw(&mut self, drawing: &Drawing, scene: &Scene) -> Result<Picture> {
        if let Some(gpu) = &mut self.gpu {
            match gpu.draw(drawing, scene) {
                Err(error) if self.choice == Choice::Auto => {
                    tracing::warn!(%error, "the GPU failed; the CPU goes on");
                    self.gpu = None;
                }
                drawn => return drawn,
            }
        }
        Ok(self.cpu.draw(drawing, scene))
    }
}
