#include "idol/base/rig.hpp"
