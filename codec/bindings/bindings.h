// What each file of bindings adds to the module.
#pragma once

#include <nanobind/nanobind.h>

void bind_deblock(nanobind::module_& m);
void bind_gradients(nanobind::module_& m);
void bind_s3dc_variable(nanobind::module_& m);
void bind_s3dc_sampler(nanobind::module_& m);
void bind_zerobit(nanobind::module_& m);
