//! What the validation layer says: collected, for tests to look at.
use ash::vk;
use std::ffi::{CStr, c_void};
use std::sync::Mutex;

/// Warnings and errors of the validation layer.
#[derive(Default)]
pub struct Messages {
    list: Mutex<Vec<String>>,
}

impl Messages {
    /// The messages so far.
    pub fn list(&self) -> Vec<String> {
        self.list.lock().map(|list| list.clone()).unwrap_or_default()
    }

    /// A messenger that writes here: these messages must outlive it.
    pub(super) fn messenger(&self) -> vk::DebugUtilsMessengerCreateInfoEXT<'static> {
        use vk::{DebugUtilsMessageSeverityFlagsEXT as Severity, DebugUtilsMessageTypeFlagsEXT as Type};
        vk::DebugUtilsMessengerCreateInfoEXT {
            p_user_data: std::ptr::from_ref(self).cast_mut().cast(),
            ..vk::DebugUtilsMessengerCreateInfoEXT::default()
                .message_severity(Severity::WARNING | Severity::ERROR)
                .message_type(Type::VALIDATION)
                .pfn_user_callback(Some(receive))
        }
    }
}

unsafe extern "system" fn receive(
    _: vk::DebugUtilsMessageSeverityFlagsEXT,
    _: vk::DebugUtilsMessageTypeFlagsEXT,
    data: *const vk::DebugUtilsMessengerCallbackDataEXT<'_>,
    user: *mut c_void,
) -> vk::Bool32 {
    // SAFETY: the layer passes valid data and the pointer given with `messenger`, whose target is alive.
    let (data, messages) = unsafe { (&*data, &*user.cast::<Messages>()) };
    if !data.p_message.is_null() {
        // SAFETY: a message is a C string.
        let text = unsafe { CStr::from_ptr(data.p_message) }.to_string_lossy().into_owned();
        if let Ok(mut list) = messages.list.lock() {
            list.push(text);
        }
    }
    vk::FALSE
}
