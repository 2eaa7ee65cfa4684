//! Compute pipelines from committed SPIR-V.
use super::device::{Access, Device};
use super::error::{DeviceError, calling};
use super::shaders::{Binding, Shader};
use ash::vk;
use std::sync::Arc;

/// A compiled kernel. All objects are released with it.
pub struct Kernel {
    device: Arc<Device>,
    set_layout: vk::DescriptorSetLayout,
    layout: vk::PipelineLayout,
    pipeline: vk::Pipeline,
    bindings: &'static [Binding],
    push_words: usize,
}

impl Kernel {
    /// Compiles `shader` with the specialisation constants 0, 1, ... of `constants` (each four bytes).
    ///
    /// # Errors
    /// Where the driver refuses.
    pub fn new(device: &Arc<Device>, shader: &Shader, constants: &[u32]) -> Result<Arc<Self>, DeviceError> {
        let code = match device.access() {
            Access::Texel => shader.texel,
            Access::Storage => shader.storage,
        };
        let mut kernel = Self {
            device: Arc::clone(device),
            set_layout: vk::DescriptorSetLayout::null(),
            layout: vk::PipelineLayout::null(),
            pipeline: vk::Pipeline::null(),
            bindings: shader.bindings,
            push_words: shader.push_words,
        };
        kernel.lay_out()?;
        kernel.compile(code, constants)?;
        Ok(Arc::new(kernel))
    }

    fn lay_out(&mut self) -> Result<(), DeviceError> {
        let bindings: Vec<_> = (0..self.bindings.len())
            .map(|at| {
                vk::DescriptorSetLayoutBinding::default()
                    .binding(at as u32)
                    .descriptor_type(self.descriptor_type(at))
                    .descriptor_count(1)
                    .stage_flags(vk::ShaderStageFlags::COMPUTE)
            })
            .collect();
        let raw = self.device.raw();
        let info = vk::DescriptorSetLayoutCreateInfo::default().bindings(&bindings);
        // SAFETY: the device is alive; `drop` releases what was made.
        self.set_layout = unsafe { raw.create_descriptor_set_layout(&info, None) }
            .map_err(calling("vkCreateDescriptorSetLayout"))?;
        let sets = [self.set_layout];
        let push = [vk::PushConstantRange::default()
            .stage_flags(vk::ShaderStageFlags::COMPUTE)
            .size(4 * self.push_words as u32)];
        let push = if self.push_words == 0 { &push[..0] } else { &push };
        let info = vk::PipelineLayoutCreateInfo::default().set_layouts(&sets).push_constant_ranges(push);
        // SAFETY: as above.
        self.layout =
            unsafe { raw.create_pipeline_layout(&info, None) }.map_err(calling("vkCreatePipelineLayout"))?;
        Ok(())
    }

    fn compile(&mut self, code: &[u8], constants: &[u32]) -> Result<(), DeviceError> {
        let raw = self.device.raw();
        let words = ash::util::read_spv(&mut std::io::Cursor::new(code))
            .map_err(|error| DeviceError::Unsupported(format!("SPIR-V: {error}")))?;
        let info = vk::ShaderModuleCreateInfo::default().code(&words);
        // SAFETY: the code was made by a compiler and is covered by the hashes of the manifest.
        let module =
            unsafe { raw.create_shader_module(&info, None) }.map_err(calling("vkCreateShaderModule"))?;
        let map =
            |at: usize| vk::SpecializationMapEntry { constant_id: at as u32, offset: 4 * at as u32, size: 4 };
        let entries: Vec<_> = (0..constants.len()).map(map).collect();
        let data: Vec<u8> = constants.iter().flat_map(|c| c.to_ne_bytes()).collect();
        let special = vk::SpecializationInfo::default().map_entries(&entries).data(&data);
        let stage = vk::PipelineShaderStageCreateInfo::default()
            .stage(vk::ShaderStageFlags::COMPUTE)
            .module(module)
            .name(c"main")
            .specialization_info(&special);
        let info = [vk::ComputePipelineCreateInfo::default().stage(stage).layout(self.layout)];
        // SAFETY: everything in `info` is alive; the module is not needed after the pipeline is made.
        let made = unsafe {
            let made = raw.create_compute_pipelines(vk::PipelineCache::null(), &info, None);
            raw.destroy_shader_module(module, None);
            made
        };
        let pipelines = made.map_err(|(_, result)| DeviceError::of("vkCreateComputePipelines", result))?;
        self.pipeline = pipelines[0];
        Ok(())
    }

    /// Kind of descriptor at binding `at`.
    pub(super) fn descriptor_type(&self, at: usize) -> vk::DescriptorType {
        match (self.bindings[at], self.device.access()) {
            (Binding::Storage, _) | (_, Access::Storage) => vk::DescriptorType::STORAGE_BUFFER,
            (Binding::Words | Binding::Indices | Binding::Reals, Access::Texel) => {
                vk::DescriptorType::UNIFORM_TEXEL_BUFFER
            }
        }
    }

    /// Texel format at binding `at`.
    pub(super) fn texel_format(&self, at: usize) -> vk::Format {
        match self.bindings[at] {
            Binding::Reals => vk::Format::R32G32B32A32_SFLOAT,
            Binding::Indices => vk::Format::R32_UINT,
            Binding::Words | Binding::Storage => vk::Format::R32G32B32A32_UINT,
        }
    }

    /// Number of bindings.
    pub(super) fn bindings(&self) -> usize {
        self.bindings.len()
    }

    /// 32-bit words of push constants.
    pub(super) fn push_words(&self) -> usize {
        self.push_words
    }

    /// Handles for recording.
    pub(super) fn raw(&self) -> (vk::DescriptorSetLayout, vk::PipelineLayout, vk::Pipeline) {
        (self.set_layout, self.layout, self.pipeline)
    }
}

impl Drop for Kernel {
    fn drop(&mut self) {
        let raw = self.device.raw();
        // SAFETY: recordings that use the kernel hold a reference to it; null handles are ignored.
        unsafe {
            raw.destroy_pipeline(self.pipeline, None);
            raw.destroy_pipeline_layout(self.layout, None);
            raw.destroy_descriptor_set_layout(self.set_layout, None);
        }
    }
}
