// Shared by all kernels: numbers and how buffers are read.
//
// Compiled with REAL_f32 or REAL_f64 (the kernel's numbers) and READ_texel, READ_storage or READ_shuffle (how it reads what
// it does not write: through texel buffers or storage buffers, the last with vectors handed round in the subgroup). A declaration such as READ_VECTORS(binding, name) makes a buffer readable as name_at(i):
// READ_VECTORS four numbers per element, READ_TEXELS as many as fill 16 bytes (PACK), READ_WORDS four 32-bit words,
// READ_INDICES one, READ_FLOATS (storage buffers only) four f32 whatever the kernel's numbers.
#extension GL_EXT_control_flow_attributes : require

#ifdef REAL_f64
#define real double
#define real3 dvec3
#define real4 dvec4
#else
#define real float
#define real3 vec3
#define real4 vec4
#endif

// Number of the workgroup: dispatches of many groups are two-dimensional.
uint group_index() {
    return gl_WorkGroupID.y * gl_NumWorkGroups.x + gl_WorkGroupID.x;
}

#ifdef REAL_f64
#define PACK 2
#define texel dvec2
#else
#define PACK 4
#define texel vec4
#endif

#ifdef READ_texel

#define READ_WORDS(BINDING, NAME) \
    layout(binding = BINDING) uniform usamplerBuffer NAME; \
    uvec4 NAME##_at(uint i) { return texelFetch(NAME, int(i)); }

#define READ_INDICES(BINDING, NAME) \
    layout(binding = BINDING) uniform usamplerBuffer NAME; \
    uint NAME##_at(uint i) { return texelFetch(NAME, int(i)).x; }

#ifdef REAL_f64
dvec2 unpack(uvec4 words) {
    return dvec2(packDouble2x32(words.xy), packDouble2x32(words.zw));
}
#define READ_VECTORS(BINDING, NAME) \
    layout(binding = BINDING) uniform usamplerBuffer NAME; \
    dvec4 NAME##_at(uint i) { \
        return dvec4(unpack(texelFetch(NAME, int(2 * i))), unpack(texelFetch(NAME, int(2 * i + 1)))); \
    }
#define READ_TEXELS(BINDING, NAME) \
    layout(binding = BINDING) uniform usamplerBuffer NAME; \
    dvec2 NAME##_at(uint i) { return unpack(texelFetch(NAME, int(i))); }
#else
#define READ_VECTORS(BINDING, NAME) \
    layout(binding = BINDING) uniform samplerBuffer NAME; \
    vec4 NAME##_at(uint i) { return texelFetch(NAME, int(i)); }
#define READ_TEXELS READ_VECTORS
#endif

#else

#define READ_BUFFER(BINDING, NAME, TYPE) \
    layout(std430, binding = BINDING) readonly buffer NAME##_block { TYPE NAME[]; }; \
    TYPE NAME##_at(uint i) { return NAME[i]; }
#define READ_WORDS(BINDING, NAME) READ_BUFFER(BINDING, NAME, uvec4)
#define READ_INDICES(BINDING, NAME) READ_BUFFER(BINDING, NAME, uint)
#define READ_VECTORS(BINDING, NAME) READ_BUFFER(BINDING, NAME, real4)
#define READ_FLOATS(BINDING, NAME) READ_BUFFER(BINDING, NAME, vec4)
#define READ_TEXELS(BINDING, NAME) READ_BUFFER(BINDING, NAME, texel)

#endif
