#pragma once

// The package's messages and the core's types have the same names in the same namespace. The names
// that the generated headers define are therefore given the ending Msg here; include this header
// instead of the generated ones wherever the core is included too.
#define VoFrame VoFrameMsg
#define ScaleEstimate ScaleEstimateMsg
#include <ground_scale_vo/ScaleEstimate.h>
#include <ground_scale_vo/VoFrame.h>
#undef VoFrame
#undef ScaleEstimate
