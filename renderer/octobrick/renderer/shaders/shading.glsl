// Blinn-Phong with the light at the eye: the light, view and half vector are one, and surfaces are
// lit from both sides.

uniform float ambient;
uniform float diffuse;
uniform float specular;
uniform float shininess;

// color is premultiplied. A zero gradient has no direction: ambient light only.
vec4 shade(vec4 color, vec3 gradient, vec3 view_world) {
    float squared = dot(gradient, gradient);
    float facing = squared > 0.0 ? min(abs(dot(gradient, view_world)) * inversesqrt(squared), 1.0) : 0.0;
    float highlight = facing > 0.0 ? specular * pow(facing, shininess) : 0.0;
    vec3 lit = color.rgb * (ambient + diffuse * facing) + vec3(highlight * color.a);
    return vec4(min(lit, vec3(color.a)), color.a);
}
