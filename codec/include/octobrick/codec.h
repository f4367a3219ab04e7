// The whole codec: each header can also be included by itself.
#pragma once

#include "octobrick/codec/deblock.h"
#include "octobrick/codec/error_stats.h"
#include "octobrick/codec/gradients.h"
#include "octobrick/codec/reduce.h"
#include "octobrick/codec/s3dc.h"
#include "octobrick/codec/s3dc_sampler.h"
#include "octobrick/codec/s3dc_variable.h"
#include "octobrick/codec/upsample.h"
#include "octobrick/codec/value_counts.h"
#include "octobrick/codec/view.h"
#include "octobrick/codec/zerobit.h"
