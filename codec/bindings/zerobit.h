#pragma once

#include <nanobind/nanobind.h>

void bind_zerobit(nanobind::module_& m);
