// Compiles the submission of a shot with its job type under node, with a stub of Flamenco's `author`, and prints the tasks as JSON.
//
//     node tools/farm/flamenco.js JOB_TYPE SUBMISSION

const fs = require("fs");
const vm = require("vm");

class Task {
    constructor(name, type) {
        if (!name.trim() || !type.trim()) {
            throw new Error("author.Task(name, type): both are required");
        }
        Object.assign(this, { name, type, commands: [], dependencies: [] });
    }

    addCommand(command) {
        this.commands.push(command);
    }

    addDependency(task) {
        this.dependencies.push(task);
    }
}

const author = {
    Task: (name, type) => new Task(name, type),
    Command: (name, parameters) => ({ name, parameters }),
};
const [type, submission] = process.argv.slice(2);
const submitted = JSON.parse(fs.readFileSync(submission, "utf8"));
const tasks = [];
const job = { ...submitted, addTask: (task) => tasks.push(task) };
const context = vm.createContext({ author, print: () => {} });
vm.runInContext(`${fs.readFileSync(type, "utf8")}\n;globalThis.found = { JOB_TYPE, compileJob };`, context);
const { JOB_TYPE, compileJob } = context.found;
for (const { key, type, required } of JOB_TYPE.settings) {
    const value = submitted.settings[key];
    const expected = type === "int32" ? "number" : type;
    if (value === undefined ? required : typeof value !== expected) {
        throw new Error(`the setting ${key} is ${JSON.stringify(value)}, expected ${type}`);
    }
}
for (const key of Object.keys(submitted.settings)) {
    if (!JOB_TYPE.settings.some((setting) => setting.key === key)) {
        throw new Error(`the job type has no setting ${key}`);
    }
}
compileJob(job);
const place = (task) => tasks.indexOf(task);
console.log(JSON.stringify(tasks.map(({ name, type, commands, dependencies }) =>
    ({ name, type, commands, after: dependencies.map(place) }))));
