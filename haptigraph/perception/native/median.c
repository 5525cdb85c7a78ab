/* The median of a few values, by Hoare's selection (Algorithm 65, CACM 1961). */

#include "native.h"

double median(double *values, int count) {
    int low = 0, high = count - 1;
    const int middle = count / 2;
    while (low < high) {
        const double pivot = values[middle];
        int left = low, right = high;
        do {
            while (values[left] < pivot) left++;
            while (pivot < values[right]) right--;
            if (left <= right) {
                const double moved = values[left];
                values[left++] = values[right];
                values[right--] = moved;
            }
        } while (left <= right);
        if (right < middle) low = left;
        if (middle < left) high = right;
    }
    return values[middle];
}
