// Blinn-Phong with up to four lights, at the eye or far away; surfaces are lit from both sides.

uniform float ambient;
uniform float diffuse;
uniform float specular;
uniform float shininess;
uniform int light_count;
uniform vec3 light_toward_world[4];  // unit length; (0, 0, 0) is a light at the eye
uniform vec3 light_color[4];

// color is premultiplied, view_world the unit vector along the ray. A gradient of zero has no
// direction: ambient light only.
vec4 shade(vec4 color, vec3 gradient, vec3 view_world) {
    float squared = dot(gradient, gradient);
    vec3 normal = squared > 0.0 ? gradient * inversesqrt(squared) : vec3(0);
    vec3 lit = color.rgb * ambient;
    for (int i = 0; i < light_count; ++i) {
        vec3 toward = light_toward_world[i];
        bool at_eye = toward == vec3(0);
        if (at_eye) toward = -view_world;
        vec3 between = at_eye ? toward : toward - view_world;  // the half vector
        float facing = min(abs(dot(normal, toward)), 1.0);
        float length_between = length(between);
        float shine = length_between > 1e-6 ? min(abs(dot(normal, between)) / length_between, 1.0) : 0.0;
        float highlight = shine > 0.0 ? specular * pow(shine, shininess) : 0.0;
        lit += light_color[i] * (color.rgb * (diffuse * facing) + vec3(highlight * color.a));
    }
    return vec4(min(lit, vec3(color.a)), color.a);
}
