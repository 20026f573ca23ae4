/* Example: lends palpate a Vulkan device that this program opened. palpate simulates on this device, and the program
 * reads the skin (the bodies' surface meshes) from palpate's buffer on the GPU, without a copy through the library. A
 * renderer would bind that buffer as vertices instead. Compile by: cc host.c -lpalpate -lvulkan */
#include <stdio.h>
#include <stdlib.h>
#include <string.h>
#include <vulkan/vulkan.h>

#include "palpate.h"

enum { STEPS = 40 };

/* How often palpate has locked the queue. */
static int locked;

static void check(palpate_status status, const char *what) {
    if (status != PALPATE_STATUS_OK) {
        fprintf(stderr, "%s: %s\n", what, palpate_last_error());
        exit(EXIT_FAILURE);
    }
}

static void vk(VkResult result, const char *what) {
    if (result != VK_SUCCESS) {
        fprintf(stderr, "%s: VkResult %d\n", what, result);
        exit(EXIT_FAILURE);
    }
}

/* palpate calls this before each use of the queue. A program with several threads takes its mutex here; this program
 * only counts the calls. */
static void lock(void *user) {
    *(int *)user += 1;
}

static void unlock(void *user) {
    (void)user;
}

static VkInstance create_instance(void) {
    VkApplicationInfo application = {.sType = VK_STRUCTURE_TYPE_APPLICATION_INFO, .apiVersion = VK_API_VERSION_1_3};
    VkInstanceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_INSTANCE_CREATE_INFO, .pApplicationInfo = &application};
    VkInstance instance;
    vk(vkCreateInstance(&info, NULL, &instance), "vkCreateInstance");
    return instance;
}

/* Returns the first queue family with graphics and compute. */
static uint32_t family_of(VkPhysicalDevice physical) {
    VkQueueFamilyProperties families[16];
    uint32_t count = 16;
    vkGetPhysicalDeviceQueueFamilyProperties(physical, &count, families);
    for (uint32_t family = 0; family < count; family++) {
        VkQueueFlags wanted = VK_QUEUE_GRAPHICS_BIT | VK_QUEUE_COMPUTE_BIT;
        if ((families[family].queueFlags & wanted) == wanted) {
            return family;
        }
    }
    fprintf(stderr, "no queue family has graphics and compute\n");
    exit(EXIT_FAILURE);
}

/* Creates a device with the features that palpate needs. */
static VkDevice create_device(VkPhysicalDevice physical, uint32_t family) {
    VkPhysicalDeviceVulkan13Features v13 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES,
                                            .synchronization2 = VK_TRUE,
                                            .dynamicRendering = VK_TRUE,
                                            .maintenance4 = VK_TRUE};
    VkPhysicalDeviceVulkan12Features v12 = {.sType = VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_2_FEATURES,
                                            .pNext = &v13,
                                            .scalarBlockLayout = VK_TRUE};
    float priority = 1.0f;
    VkDeviceQueueCreateInfo queue = {.sType = VK_STRUCTURE_TYPE_DEVICE_QUEUE_CREATE_INFO,
                                     .queueFamilyIndex = family,
                                     .queueCount = 1,
                                     .pQueuePriorities = &priority};
    VkDeviceCreateInfo info = {.sType = VK_STRUCTURE_TYPE_DEVICE_CREATE_INFO,
                               .pNext = &v12,
                               .queueCreateInfoCount = 1,
                               .pQueueCreateInfos = &queue};
    VkDevice device;
    vk(vkCreateDevice(physical, &info, NULL, &device), "vkCreateDevice");
    return device;
}

/* Creates a buffer that the CPU can read. */
static VkDeviceMemory create_readable(VkPhysicalDevice physical, VkDevice device, VkDeviceSize bytes, VkBuffer *buffer) {
    VkBufferCreateInfo info = {.sType = VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO,
                               .size = bytes,
                               .usage = VK_BUFFER_USAGE_TRANSFER_DST_BIT};
    vk(vkCreateBuffer(device, &info, NULL, buffer), "vkCreateBuffer");
    VkMemoryRequirements needs;
    vkGetBufferMemoryRequirements(device, *buffer, &needs);
    VkPhysicalDeviceMemoryProperties kinds;
    vkGetPhysicalDeviceMemoryProperties(physical, &kinds);
    VkMemoryPropertyFlags wanted = VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | VK_MEMORY_PROPERTY_HOST_COHERENT_BIT;
    uint32_t kind = 0;
    while (!(needs.memoryTypeBits >> kind & 1) || (kinds.memoryTypes[kind].propertyFlags & wanted) != wanted) {
        kind++;
    }
    VkMemoryAllocateInfo allocate = {
        .sType = VK_STRUCTURE_TYPE_MEMORY_ALLOCATE_INFO, .allocationSize = needs.size, .memoryTypeIndex = kind};
    VkDeviceMemory memory;
    vk(vkAllocateMemory(device, &allocate, NULL, &memory), "vkAllocateMemory");
    vk(vkBindBufferMemory(device, *buffer, memory, 0), "vkBindBufferMemory");
    return memory;
}

/* Copies the skin out of palpate's buffer by a command of this program on the lent queue, and waits for its end. */
static void copy(VkDevice device, VkQueue queue, uint32_t family, VkBuffer from, VkBuffer to, VkDeviceSize bytes) {
    VkCommandPoolCreateInfo info = {.sType = VK_STRUCTURE_TYPE_COMMAND_POOL_CREATE_INFO, .queueFamilyIndex = family};
    VkCommandPool pool;
    vk(vkCreateCommandPool(device, &info, NULL, &pool), "vkCreateCommandPool");
    VkCommandBufferAllocateInfo allocate = {
        .sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_ALLOCATE_INFO, .commandPool = pool, .commandBufferCount = 1};
    VkCommandBuffer commands;
    vk(vkAllocateCommandBuffers(device, &allocate, &commands), "vkAllocateCommandBuffers");
    VkCommandBufferBeginInfo begin = {.sType = VK_STRUCTURE_TYPE_COMMAND_BUFFER_BEGIN_INFO};
    vk(vkBeginCommandBuffer(commands, &begin), "vkBeginCommandBuffer");
    VkBufferCopy whole = {.size = bytes};
    vkCmdCopyBuffer(commands, from, to, 1, &whole);
    vk(vkEndCommandBuffer(commands), "vkEndCommandBuffer");
    VkSubmitInfo submit = {.sType = VK_STRUCTURE_TYPE_SUBMIT_INFO, .commandBufferCount = 1, .pCommandBuffers = &commands};
    vk(vkQueueSubmit(queue, 1, &submit, VK_NULL_HANDLE), "vkQueueSubmit");
    vk(vkQueueWaitIdle(queue), "vkQueueWaitIdle");
    vkDestroyCommandPool(device, pool, NULL);
}

int main(int argc, char **argv) {
    if (argc != 2) {
        fprintf(stderr, "usage: %s SCENE\n", argv[0]);
        return 2;
    }
    VkInstance instance = create_instance();
    VkPhysicalDevice physical;
    uint32_t count = 1;
    VkResult found = vkEnumeratePhysicalDevices(instance, &count, &physical);
    if ((found != VK_SUCCESS && found != VK_INCOMPLETE) || count == 0) {
        fprintf(stderr, "no Vulkan device\n");
        return EXIT_FAILURE;
    }
    uint32_t family = family_of(physical);
    VkDevice device = create_device(physical, family);
    VkQueue queue;
    vkGetDeviceQueue(device, family, 0, &queue);

    palpate_vulkan vulkan = {.size = sizeof vulkan,
                             .get_instance_proc_addr = (void (*)(void))vkGetInstanceProcAddr,
                             .instance = instance,
                             .physical_device = physical,
                             .device = device,
                             .queue = queue,
                             .queue_family = family,
                             .lock = lock,
                             .unlock = unlock,
                             .lock_user = &locked};
    palpate_context *context = NULL;
    palpate_scene *scene = NULL;
    palpate_simulation *simulation = NULL;
    check(palpate_context_create_on(&vulkan, &context), "the host's device");
    check(palpate_scene_load(argv[1], &scene), "no scene");
    check(palpate_simulation_create(context, scene, &simulation), "no simulation");
    palpate_wrench wrench = {.size = sizeof wrench};
    for (int step = 0; step < STEPS; step++) {
        check(palpate_step(simulation, NULL, &wrench), "step");
    }

    palpate_skins skins = {.size = sizeof skins};
    check(palpate_skin_buffers(simulation, NULL, &skins), "skins");
    VkDeviceSize bytes = (VkDeviceSize)skins.vertex_count * 4 * sizeof(float);
    VkBuffer readable;
    VkDeviceMemory memory = create_readable(physical, device, bytes, &readable);
    /* VkBuffer is a pointer on some platforms and an integer on others, so it is copied and not cast. */
    VkBuffer positions;
    memcpy(&positions, &skins.positions, sizeof positions);
    copy(device, queue, family, positions, readable, bytes);
    void *mapped;
    vk(vkMapMemory(device, memory, 0, bytes, 0, &mapped), "vkMapMemory");
    const float *own = mapped;

    /* Reads the skin of body 0 through the library, and compares it with the start of palpate's buffer, where the
     * vertices of body 0 lie. */
    size_t vertices = 0;
    check(palpate_skin(simulation, 0, NULL, NULL, NULL, 0, &vertices), "skin");
    float(*told)[3] = malloc(vertices * sizeof *told);
    check(palpate_skin(simulation, 0, NULL, told, NULL, vertices, &vertices), "skin");
    float highest = told[0][1];
    for (size_t vertex = 0; vertex < vertices; vertex++) {
        if (memcmp(told[vertex], own + 4 * vertex, sizeof *told) != 0) {
            fprintf(stderr, "vertex %zu differs between the shared buffer and the library's copy\n", vertex);
            return EXIT_FAILURE;
        }
        highest = told[vertex][1] > highest ? told[vertex][1] : highest;
    }
    printf("force %.17g N upwards, %zu vertices shared, the highest at %.6f m, the queue locked %d times\n",
           wrench.force[1], vertices, (double)highest, locked);

    free(told);
    check(palpate_simulation_destroy(simulation), "simulation");
    check(palpate_scene_destroy(scene), "scene");
    check(palpate_context_destroy(context), "context");
    /* The Vulkan objects are destroyed last, because the context and its simulation used them. */
    vkDestroyBuffer(device, readable, NULL);
    vkFreeMemory(device, memory, NULL);
    vkDestroyDevice(device, NULL);
    vkDestroyInstance(instance, NULL);
    return EXIT_SUCCESS;
}
