#pragma once
#include <cstdlib>
inline double exp_value(const char* name, double value) { const char* s = std::getenv(name); return s ? std::atof(s) : value; }
#define X(name, value) ([]() -> double { static const double v = exp_value(#name, value); return v; }())
